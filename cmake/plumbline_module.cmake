# plumbline_module(name [DEPS modules...] [EXPOSE targets...] [LINK targets...])
# A stage of the house: include/plumbline/<name>, src/<name>, tests/<name>. DEPS are the modules that its headers and
# sources may include (tests/architecture checks it); LINK are third-party targets, needed by its .cpp files only;
# EXPOSE are those that its public headers include.
function(plumbline_module name)
  cmake_parse_arguments(ARG "" "" "DEPS;EXPOSE;LINK" ${ARGN})
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/src/${name}/*.cpp)
  list(FILTER sources EXCLUDE REGEX "_module\\.cpp$")  # built as shared objects of their own
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/include/plumbline/${name}/*.hpp)
  set(library plumbline_${name})
  add_library(${library} STATIC ${sources})
  add_library(plumbline::${name} ALIAS ${library})
  set_target_properties(${library} PROPERTIES EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON)
  target_sources(${library} PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}/include FILES ${headers})
  target_include_directories(${library} PRIVATE ${PROJECT_SOURCE_DIR}/src)
  target_compile_features(${library} PUBLIC cxx_std_20)
  set_target_properties(${library} PROPERTIES CXX_EXTENSIONS OFF)
  foreach(dep ${ARG_DEPS})
    target_link_libraries(${library} PUBLIC plumbline_${dep})
  endforeach()
  target_link_libraries(${library} PUBLIC Eigen3::Eigen ${ARG_EXPOSE} PRIVATE fmt::fmt ${ARG_LINK} plumbline_warnings)
  if(PLUMBLINE_PCH)
    if(name STREQUAL core)
      target_precompile_headers(${library} PRIVATE <Eigen/Dense> <algorithm> <cmath> <functional> <map> <memory>
        <optional> <span> <string> <string_view> <utility> <variant> <vector>)
    else()
      target_precompile_headers(${library} REUSE_FROM plumbline_core)
    endif()
  endif()
  install(TARGETS ${library} EXPORT plumblineTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
  set_property(GLOBAL APPEND PROPERTY PLUMBLINE_MODULES ${name})
  set_property(GLOBAL PROPERTY PLUMBLINE_DEPS_${name} ${ARG_DEPS})
endfunction()

# The tests of a module: one executable of all tests/<name>/*_test.cpp, and one CTest entry for each of its suites.
function(plumbline_tests name)
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${name}/*_test.cpp)
  if(NOT sources)
    return()
  endif()
  add_executable(${name}_test ${sources})
  target_link_libraries(${name}_test PRIVATE plumbline_test_support ${ARGN})
  if(PLUMBLINE_PCH)
    target_precompile_headers(${name}_test REUSE_FROM plumbline_test_support)
  endif()
  set(entries ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake)
  add_custom_command(TARGET ${name}_test POST_BUILD BYPRODUCTS ${entries} VERBATIM
    COMMAND ${CMAKE_COMMAND} -D NAME=${name} -D EXECUTABLE=$<TARGET_FILE:${name}_test> -D OUTPUT=${entries}
      -D SECONDS=300 -P ${PROJECT_SOURCE_DIR}/cmake/discover_suites.cmake)
  file(WRITE ${entries}.include.cmake "if(EXISTS [=[${entries}]=])\n  include([=[${entries}]=])\nelse()\n"
    "  add_test(${name}_NOT_BUILT ${name}_NOT_BUILT)\nendif()\n")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${entries}.include.cmake)
endfunction()
