# What `cmake --install` puts where: the libraries with their headers and find_package(faultline), and
# the program.
#
#   find_package(faultline COMPONENTS drivers)      the CAN layer: faultline::drivers_can, drivers_dbc,
#                                                   drivers_signal; needs fmt
#   find_package(faultline COMPONENTS diagnosis)    also model, bank, design, certify and run time
#
# Includes read as in the source tree: #include "drivers/dbc/dbc_parser.h".
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(faultline_include_dir ${CMAKE_INSTALL_INCLUDEDIR}/faultline)
set(faultline_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/faultline)

# faultline_install(<component> <targets>): static libraries and their headers.
function(faultline_install component)
  install(TARGETS ${ARGN} EXPORT faultline_${component}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${component}
    FILE_SET HEADERS DESTINATION ${faultline_include_dir} COMPONENT ${component})
  install(EXPORT faultline_${component} COMPONENT ${component} NAMESPACE faultline::
    DESTINATION ${faultline_cmake_dir} FILE faultline_${component}.cmake)
endfunction()

set_target_properties(faultline_build_options PROPERTIES EXPORT_NAME build_options)
faultline_install(drivers
  faultline_build_options faultline_drivers_can faultline_drivers_dbc faultline_drivers_signal)
if(NOT FAULTLINE_DRIVERS_ONLY)
  faultline_install(diagnosis
    faultline_diagnosis_model faultline_diagnosis_bank faultline_diagnosis_design
    faultline_diagnosis_certify faultline_diagnosis_runtime)
  install(FILES cmake/FindCSDP.cmake DESTINATION ${faultline_cmake_dir} COMPONENT diagnosis)
  # All that a plant in a shared library is built from (examples/plant_library).
  install(FILES sim/plant_table.h sim/plant_equations.h
    DESTINATION ${faultline_include_dir}/sim COMPONENT diagnosis)
  install(TARGETS faultline RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
  if(TARGET faultline_mpi)
    install(TARGETS faultline_mpi
      LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/faultline COMPONENT program)
  endif()
endif()

configure_package_config_file(cmake/faultline-config.cmake.in ${PROJECT_BINARY_DIR}/faultline-config.cmake
  INSTALL_DESTINATION ${faultline_cmake_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/faultline-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/faultline-config.cmake
              ${PROJECT_BINARY_DIR}/faultline-config-version.cmake
  DESTINATION ${faultline_cmake_dir} COMPONENT drivers)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT drivers)
