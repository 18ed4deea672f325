# Run by a test executable's build: writes OUTPUT, a file of CTest entries, one for each suite of the gtest executable
# EXECUTABLE. One process a suite and not one a test, because the start of a process that links OpenCV costs 0.13 s.
execute_process(COMMAND ${EXECUTABLE} --gtest_list_tests OUTPUT_VARIABLE list RESULT_VARIABLE status TIMEOUT 60)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "${EXECUTABLE} --gtest_list_tests failed: ${status}\n${list}")
endif()
string(REGEX MATCHALL "\n[A-Za-z0-9_/]+\\." suites "\n${list}")
set(text "")
foreach(suite ${suites})
  string(REGEX REPLACE "[\n.]" "" suite "${suite}")
  # In CTest's file "${NAME}/..." is literal text; brackets keep every character as it is.
  string(APPEND text "add_test([=[${NAME}/${suite}]=] [=[${EXECUTABLE}]=] [=[--gtest_filter=${suite}.*]=])\n"
    "set_tests_properties([=[${NAME}/${suite}]=] PROPERTIES LABELS ${NAME} TIMEOUT ${SECONDS} SKIP_RETURN_CODE 77)\n")
endforeach()
file(WRITE ${OUTPUT} "${text}")
