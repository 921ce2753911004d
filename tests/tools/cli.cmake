# The program as a user meets it.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

foreach(test IN ITEMS design_cli faultline_cli integrity_cli lcm_logger)
  add_test(NAME ${test} COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/${test}_test.py)
  set_tests_properties(${test} PROPERTIES
    TIMEOUT 120
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>")
endforeach()
