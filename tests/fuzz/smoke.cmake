# Runs every fuzzer for a minute on its seeds as part of the tests. They are built by clang in a build
# tree inside this one.
find_program(FAULTLINE_CLANG clang++ REQUIRED)
include(ExternalProject)
set(fuzz_dir ${PROJECT_BINARY_DIR}/fuzz)
ExternalProject_Add(fuzzers
  SOURCE_DIR ${PROJECT_SOURCE_DIR}
  BINARY_DIR ${fuzz_dir}
  PREFIX ${fuzz_dir}/external
  CMAKE_ARGS --preset fuzz -G Ninja -B ${fuzz_dir} -D CMAKE_CXX_COMPILER=${FAULTLINE_CLANG}
  BUILD_ALWAYS ON
  INSTALL_COMMAND "")

set(FAULTLINE_FUZZ_SECONDS 60 CACHE STRING "How long a test runs each fuzzer")
foreach(fuzzer IN ITEMS dbc_parser message_codec candump udp_frame log_reader viewer_request)
  add_test(NAME ${fuzzer}_fuzzer
    COMMAND Python3::Interpreter ${CMAKE_CURRENT_LIST_DIR}/fuzz_smoke.py
            --seconds ${FAULTLINE_FUZZ_SECONDS} --corpus ${CMAKE_CURRENT_LIST_DIR}/corpus/${fuzzer}
            --dict ${CMAKE_CURRENT_LIST_DIR}/${fuzzer}.dict ${fuzz_dir}/bin/${fuzzer}_fuzzer)
  set_tests_properties(${fuzzer}_fuzzer PROPERTIES LABELS fuzz TIMEOUT 300)
endforeach()
