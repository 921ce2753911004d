# Options every target of the project shares, whatever the preset.
#
# Residuals must be equal to the bit in every build (docs/decisions/0001-determinism.md): one
# instruction set, no contraction of a*b+c, no re-association. Eigen's alignment follows the
# instruction set, so the flag is part of the interface of everything that shows an Eigen type.
set(FAULTLINE_ARCH "" CACHE STRING "Value of -march; empty: x86-64-v3 on x86-64, compiler's default elsewhere")
if(FAULTLINE_ARCH STREQUAL "" AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(faultline_march x86-64-v3)
else()
  set(faultline_march ${FAULTLINE_ARCH})
endif()

add_library(faultline_build_options INTERFACE)
add_library(faultline::build_options ALIAS faultline_build_options)
target_compile_features(faultline_build_options INTERFACE cxx_std_20)
target_compile_options(faultline_build_options INTERFACE
  -ffp-contract=off
  $<$<BOOL:${faultline_march}>:-march=${faultline_march}>)
target_include_directories(faultline_build_options INTERFACE
  $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
  $<INSTALL_INTERFACE:include/faultline>)

# faultline_library(<folder target> SOURCES ... HEADERS ... PUBLIC ... PRIVATE ...): a folder's static
# library with its alias faultline::<folder target>. HEADERS are what others may include once it is
# installed (cmake/install.cmake); inside the project every header may be.
function(faultline_library name)
  cmake_parse_arguments(arg "" "" "SOURCES;HEADERS;PUBLIC;PRIVATE" ${ARGN})
  add_library(faultline_${name} STATIC ${arg_SOURCES})
  add_library(faultline::${name} ALIAS faultline_${name})
  set_target_properties(faultline_${name} PROPERTIES EXPORT_NAME ${name})
  target_sources(faultline_${name} PUBLIC
    FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES ${arg_HEADERS})
  target_link_libraries(faultline_${name}
    PUBLIC faultline::build_options ${arg_PUBLIC}
    PRIVATE ${arg_PRIVATE})
endfunction()
