# What building an interface package against the ROS wheels of PyPI needs, kept out of the packages themselves: colcon.meta
# hands this file to them as CMAKE_PROJECT_INCLUDE. A native ROS needs none of it.

# The wheels' exported targets name include directories of the machine that built the wheels, for example
# /opt/python/cp311-cp311/include, and CMake refuses to generate with these. Drops the ones that do not exist from every
# imported target.
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

# The generated type supports are hundreds of small files that all read the same headers. Compiling them in groups halves
# the time. Left out are the libraries whose files define the same names: rosidl_generator_c and introspection_cpp.
function(hmap_compile_in_groups directory)
  set(grouped "__rosidl_typesupport_(c|cpp|fastrtps_c|fastrtps_cpp|introspection_c)$")
  get_property(targets DIRECTORY ${directory} PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    if(target MATCHES "${grouped}")
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    endif()
  endforeach()
endfunction()

# Deferred until the project has found its packages and declared its targets. CMAKE_PROJECT_INCLUDE is read at every
# project() call; the first one is enough.
get_property(deferred GLOBAL PROPERTY HMAP_ROS_WHEELS)
if(NOT deferred)
  set_property(GLOBAL PROPERTY HMAP_ROS_WHEELS TRUE)
  cmake_language(DEFER DIRECTORY ${CMAKE_SOURCE_DIR} CALL hmap_drop_missing_includes ${CMAKE_SOURCE_DIR})
  cmake_language(DEFER DIRECTORY ${CMAKE_SOURCE_DIR} CALL hmap_compile_in_groups ${CMAKE_SOURCE_DIR})
endif()
