# The ROS wheels' exported CMake targets name include directories of the machine that built the wheels, for example
# /opt/python/cp311-cp311/include. CMake refuses to generate with such a target. This drops the directories that do not
# exist from every imported target, once the project has found all its packages.
#
# colcon.meta hands it to the packages as CMAKE_PROJECT_INCLUDE, so the packages themselves stay as they are elsewhere.

function(hmap_drop_missing_includes directory)
  get_property(targets DIRECTORY ${directory} PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(includes ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(includes)
      set(existing "")
      foreach(include IN LISTS includes)
        if(include MATCHES "\\$<" OR EXISTS "${include}")
          list(APPEND existing "${include}")
        endif()
      endforeach()
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${existing}")
    endif()
  endforeach()
  get_property(subdirectories DIRECTORY ${directory} PROPERTY SUBDIRECTORIES)
  foreach(subdirectory IN LISTS subdirectories)
    hmap_drop_missing_includes(${subdirectory})
  endforeach()
endfunction()

# CMAKE_PROJECT_INCLUDE is read at every project() call; the first one is enough.
get_property(deferred GLOBAL PROPERTY HMAP_DROP_MISSING_INCLUDES)
if(NOT deferred)
  set_property(GLOBAL PROPERTY HMAP_DROP_MISSING_INCLUDES TRUE)
  cmake_language(DEFER DIRECTORY ${CMAKE_SOURCE_DIR} CALL hmap_drop_missing_includes ${CMAKE_SOURCE_DIR})
endif()
