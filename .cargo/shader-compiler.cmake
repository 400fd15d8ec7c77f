# How cargo has the shader compiler built (config.toml beside this names the file to cmake). It is built once and
# runs for half a minute, so its build is what costs: with -O3 it would take a fifth longer, and without the changes
# to its targets twice as long.
set(CMAKE_C_FLAGS_RELEASE "-O1 -DNDEBUG" CACHE STRING "")
set(CMAKE_CXX_FLAGS_RELEASE "-O1 -DNDEBUG" CACHE STRING "")
set(SHADERC_SKIP_EXAMPLES ON CACHE BOOL "")
set(SKIP_SPIRV_TOOLS_INSTALL ON CACHE BOOL "")
set(GLSLANG_ENABLE_INSTALL OFF CACHE BOOL "")
set(CMAKE_PROJECT_native-shaderc_INCLUDE ${CMAKE_CURRENT_LIST_DIR}/shader-compiler-targets.cmake CACHE FILEPATH "")
