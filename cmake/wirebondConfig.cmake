# What find_package(wirebond) gives: wirebond::core, the headers that every generated header needs; wirebond::posix, ttys
# for hosts; wirebond_protocol(), which runs the generator. It lies beside core/ and ports/, in the source tree, in the
# Python package and in an installation alike.

get_filename_component(_wirebond_root "${CMAKE_CURRENT_LIST_DIR}/.." ABSOLUTE)

if(NOT TARGET wirebond::core)
  add_library(wirebond::core INTERFACE IMPORTED)
  set_property(TARGET wirebond::core PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${_wirebond_root}/core/include")
  set_property(TARGET wirebond::core PROPERTY INTERFACE_COMPILE_FEATURES cxx_std_17)
endif()
if(NOT TARGET wirebond::posix)
  add_library(wirebond::posix INTERFACE IMPORTED)
  set_property(TARGET wirebond::posix PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${_wirebond_root}/ports/posix/include")
  set_property(TARGET wirebond::posix PROPERTY INTERFACE_LINK_LIBRARIES wirebond::core)
endif()
unset(_wirebond_root)

# The command of the same Python environment, or of this clone; otherwise that of the PATH.
find_program(WIREBOND_COMMAND wirebond HINTS "${CMAKE_CURRENT_LIST_DIR}/../../../../../../bin"
             "${CMAKE_CURRENT_LIST_DIR}/../.venv/bin"
             DOC "the wirebond command, for wirebond_protocol()")

# wirebond_protocol(<target> <file>...)
#
# Generates the C++ of protocol files while CMake configures, and again when a file changes. The target, and what links
# it, can then include "<protocol>.hpp".
function(wirebond_protocol target)
  if(NOT WIREBOND_COMMAND)
    message(FATAL_ERROR "wirebond_protocol: there is no wirebond command on the PATH; say where it is: "
                        "-DWIREBOND_COMMAND=<path>")
  endif()
  set(generated "${CMAKE_CURRENT_BINARY_DIR}/wirebond_${target}")
  foreach(file IN LISTS ARGN)
    get_filename_component(file "${file}" ABSOLUTE)
    execute_process(COMMAND "${WIREBOND_COMMAND}" gen "${file}" --out "${generated}"
                    RESULT_VARIABLE failed OUTPUT_QUIET ERROR_VARIABLE sentence)
    if(failed)
      message(FATAL_ERROR "wirebond_protocol: ${sentence}")
    endif()
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${file}")
  endforeach()
  get_target_property(kind ${target} TYPE)
  if(kind STREQUAL "INTERFACE_LIBRARY")
    set(scope INTERFACE)
  else()
    set(scope PUBLIC)
  endif()
  # Before others: the folder has the core headers that its generated headers were made with.
  target_include_directories(${target} BEFORE ${scope} "${generated}")
  target_compile_features(${target} ${scope} cxx_std_17)
endfunction()
