# Debian's libmrcal-dev has neither a pkg-config nor a CMake file.
find_path(MRCAL_INCLUDE_DIR mrcal/mrcal.h)
find_library(MRCAL_LIBRARY mrcal)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Mrcal REQUIRED_VARS MRCAL_LIBRARY MRCAL_INCLUDE_DIR)
if(Mrcal_FOUND AND NOT TARGET Mrcal::mrcal)
  add_library(Mrcal::mrcal UNKNOWN IMPORTED)
  set_target_properties(Mrcal::mrcal PROPERTIES IMPORTED_LOCATION ${MRCAL_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${MRCAL_INCLUDE_DIR})
endif()
