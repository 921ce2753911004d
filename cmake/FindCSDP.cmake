# CSDP, the solver of semidefinite programs behind diagnosis_design (Debian: libsdp-dev). Defines
# CSDP::CSDP. The shared library brings LAPACK and BLAS along; the static one needs them named.
find_path(CSDP_INCLUDE_DIR csdp/declarations.h)
find_library(CSDP_LIBRARY sdp)
mark_as_advanced(CSDP_INCLUDE_DIR CSDP_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(CSDP REQUIRED_VARS CSDP_LIBRARY CSDP_INCLUDE_DIR)

if(CSDP_FOUND AND NOT TARGET CSDP::CSDP)
  add_library(CSDP::CSDP UNKNOWN IMPORTED)
  set_target_properties(CSDP::CSDP PROPERTIES
    IMPORTED_LOCATION "${CSDP_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${CSDP_INCLUDE_DIR}")
  if(CSDP_LIBRARY MATCHES "\\.a$")
    set_target_properties(CSDP::CSDP PROPERTIES INTERFACE_LINK_LIBRARIES "lapack;blas;m")
  endif()
endif()
