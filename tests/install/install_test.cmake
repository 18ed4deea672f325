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

# Moved: nothing may hang on the folder that the library was built in or installed to first.
file(RENAME ${place}/stranger ${place}/moved)
run(IN ${place} DO moved/00_lens)
run(IN ${place} DO moved/03_own_detections)
run(IN ${place} DO prefix/bin/plumbline list lenses)

# The examples that read photographs, which also need the image codecs' module of the installed library.
set(images $ENV{PLUMBLINE_DEMO_IMAGES})
if(images)
  file(GLOB left ${images}/left*.jpg)
  file(GLOB right ${images}/right*.jpg)
  list(LENGTH left n_pairs)
  run(IN ${place} DO moved/01_calibrate_mono camera.yaml ${left})
  run(IN ${place} DO moved/02_stereo_rectify rectified ${n_pairs} ${left} ${right})
  foreach(file camera.yaml rectified/left.png rectified/right.png)
    if(NOT EXISTS ${place}/${file})
      message(FATAL_ERROR "an example has not written ${file}")
    endif()
  endforeach()
elseif("$ENV{PLUMBLINE_REQUIRE_DATA}" STREQUAL "1")
  message(FATAL_ERROR "PLUMBLINE_REQUIRE_DATA=1, but PLUMBLINE_DEMO_IMAGES is not set")
else()
  # In the form of GoogleTest's own line, so that ./dev test counts it among the skipped tests.
  execute_process(COMMAND ${CMAKE_COMMAND} -E echo "[  SKIPPED ] Install.ExamplesOnPhotographs (0 ms)")
endif()
