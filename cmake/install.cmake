# What `cmake --install` leaves behind, so that find_package(plumbline) works in a stranger's project.
include(CMakePackageConfigHelpers)
set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/plumbline)
install(TARGETS plumbline RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(TARGETS plumbline_imageio plumbline_videoio LIBRARY DESTINATION ${module_dir})
install(TARGETS plumbline_all EXPORT plumblineTargets)
install(EXPORT plumblineTargets NAMESPACE plumbline:: DESTINATION ${config_dir})
configure_package_config_file(cmake/plumblineConfig.cmake.in ${CMAKE_BINARY_DIR}/plumblineConfig.cmake
  INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/plumblineConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/plumblineConfig.cmake ${CMAKE_BINARY_DIR}/plumblineConfigVersion.cmake
  cmake/FindMrcal.cmake DESTINATION ${config_dir})
