# The program as a user meets it.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

foreach(test IN ITEMS
    bad_input
    can_cli
    check_cli
    dash
    design_cli
    doctor_cli
    eigenstructure_cli
    faultline_cli
    hostile_input
    info_cli
    inject
    integrity_cli
    lcm_logger
    linearise
    log_cli
    nodes
    playback
    rates
    replay_cli
    report_cli
    run_cli
    run_failures
    run_interruption
    scenario_input
    score
    scorecard
    suite_cli
    thresholds
    watch)
  add_test(NAME ${test} COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/${test}_test.py)
  set_tests_properties(${test} PROPERTIES
    TIMEOUT 240 # the playbacks take 75 s on a quiet machine: most of it is waiting
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>")
endforeach()

# Thousands of runs in a database.
add_test(NAME campaign_cli
  COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/campaign_test.py
          Runs SameWhoeverDoesThem GoesOn Failures Refusals)
set_tests_properties(campaign_cli PROPERTIES
  TIMEOUT 240 # takes 10 s on a quiet machine
  ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>")
if(TARGET faultline_mpi)
  add_test(NAME campaign_mpi
    COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/campaign_test.py Ranks)
  set_tests_properties(campaign_mpi PROPERTIES
    TIMEOUT 180
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;MPIRUN=${MPIEXEC_EXECUTABLE}")
endif()

# A plant of the user's own, with the compiler that has built the program.
add_test(NAME plant_library COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/plant_library_test.py)
set_tests_properties(plant_library PROPERTIES
  TIMEOUT 240 # takes 10 s on a quiet machine: most of it is compiling
  ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;CMAKE=${CMAKE_COMMAND};CXX=${CMAKE_CXX_COMPILER}")

# On real CAN sockets, which sanitized programs cannot have (see tests/drivers).
if(NOT FAULTLINE_SANITIZER)
  add_test(NAME can_bus
    COMMAND ${PROJECT_SOURCE_DIR}/tools/with-vcan -t 120 -i vcan0 -i vcan1 --
            ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/can_bus_test.py)
  set_tests_properties(can_bus PROPERTIES
    LABELS vcan
    TIMEOUT 150
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;WITH_VCAN_INIT=$<TARGET_FILE:vcan_init>")

  add_test(NAME dash_page
    COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/dash_page_test.py)
  set_tests_properties(dash_page PROPERTIES
    LABELS vcan
    TIMEOUT 300
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;WITH_VCAN_INIT=$<TARGET_FILE:vcan_init>")

  add_test(NAME playback_vcan
    COMMAND ${PROJECT_SOURCE_DIR}/tools/with-vcan -t 120 -i vcan0 --
            ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/playback_vcan_test.py)
  set_tests_properties(playback_vcan PROPERTIES
    LABELS vcan
    TIMEOUT 150
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;WITH_VCAN_INIT=$<TARGET_FILE:vcan_init>")

  add_test(NAME nodes_vcan
    COMMAND ${PROJECT_SOURCE_DIR}/tools/with-vcan -t 280 -i vcan0 --
            ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/nodes_test.py Nodes.test_each_node_may_die_and_come_back)
  set_tests_properties(nodes_vcan PROPERTIES
    LABELS vcan
    TIMEOUT 300
    ENVIRONMENT "FAULTLINE=$<TARGET_FILE:faultline>;WITH_VCAN_INIT=$<TARGET_FILE:vcan_init>;NODES_BUS=can:vcan0")
endif()
