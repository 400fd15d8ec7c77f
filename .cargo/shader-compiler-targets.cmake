# Included by the shader compiler's own project; changes its targets once all are known.
if(CMAKE_VERSION VERSION_LESS 3.19)
    return()
endif()

function(change_targets)
    # A third of the sources are a shared library and tools for other ends. No option leaves them out.
    foreach(target SPIRV-Tools-shared SPIRV-Tools-reduce SPIRV-Tools-lint SPIRV-Tools-diff SPIRV-Tools-link)
        if(TARGET ${target})
            set_property(TARGET ${target} PROPERTY EXCLUDE_FROM_ALL TRUE)
        endif()
    endforeach()
    # Two thirds of the time of a file went to headers that most files share: many files are compiled as one, but for
    # those that give something of their own a name that another file gives too.
    function(compile_as_one target)
        if(NOT TARGET ${target})
            return()
        endif()
        set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 12)
        list(TRANSFORM ARGN PREPEND ${CMAKE_SOURCE_DIR}/)
        set_source_files_properties(${ARGN} TARGET_DIRECTORY ${target} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endfunction()
    compile_as_one(glslang glslang/SPIRV/SpvBuilder.cpp)
    compile_as_one(SPIRV-Tools-static
        spirv-tools/source/spirv_reducer_options.cpp
        spirv-tools/source/val/validate_ray_tracing_reorder.cpp)
    set(passes basic_block canonicalize_ids_pass ir_context local_single_block_elim_pass local_single_store_elim_pass
        mem_pass pass reduce_load_size)
    list(TRANSFORM passes REPLACE "(.+)" "spirv-tools/source/opt/\\1.cpp")
    compile_as_one(SPIRV-Tools-opt ${passes})
    if(TARGET SPIRV-Tools-opt)
        target_precompile_headers(SPIRV-Tools-opt PRIVATE ${CMAKE_SOURCE_DIR}/spirv-tools/source/opt/ir_context.h)
    endif()
endfunction()
cmake_language(DEFER CALL change_targets)
