# Variables: BUILD and SOURCE of Plumbline, GENERATOR, COMPILER and FLAGS it was built with.
set(place ${BUILD}/install_test)
file(REMOVE_RECURSE ${place})
file(MAKE_DIRECTORY ${place})

function(run)
  cmake_parse_arguments(ARG "" "IN" "DO" ${ARGN})
  execute_process(COMMAND ${ARG_DO} WORKING_DIRECTORY ${ARG_IN} RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE out)
  string(REPLACE ";" " " command "${ARG_DO}")
  message("$ ${command}\n${out}")
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "exit code ${status}: ${command}")
  endif()
endfunction()

run(IN ${place} DO ${CMAKE_COMMAND} --install ${BUILD} --prefix ${place}/prefix)

# The examples are copied, so that nothing beside them in the source tree can help.
file(COPY ${SOURCE}/examples DESTINATION ${place})
run(IN ${place} DO ${CMAKE_COMMAND} -S examples -B stranger -G ${GENERATOR} -DCMAKE_PREFIX_PATH=${place}/prefix
  -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS=${FLAGS})
run(IN ${place} DO ${CMAKE_COMMAND} --build stranger)

# The package that was found is the installed one, and no path of the source tree is in it.
file(STRINGS ${place}/stranger/CMakeCache.txt found REGEX "^plumbline_DIR")
if(NOT found MATCHES "${place}/prefix/")
  message(FATAL_ERROR "another plumbline was found: ${found}")
endif()
file(GLOB_RECURSE configs ${place}/prefix/*.cmake)
foreach(config ${configs})
  file(READ ${config} text)
  string(FIND "${text}" "${SOURCE}/" at)
  if(NOT at EQUAL -1)
    message(FATAL_ERROR "${config} names the source tree: it works only on this machine")
  endif()
endforeach()

run(IN ${place} DO ${CMAKE_COMMAND} --build stranger --target run_examples)
run(IN ${place} DO ${place}/prefix/bin/plumbline list lenses)
