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
    # Two thirds of the time of a file went to headers that most files share.
    set(source ${CMAKE_SOURCE_DIR}/spirv-tools/source)
    if(TARGET SPIRV-Tools-opt)
        target_precompile_headers(SPIRV-Tools-opt PRIVATE ${source}/opt/ir_context.h ${source}/opt/ir_builder.h)
    endif()
    if(TARGET SPIRV-Tools-static)
        target_precompile_headers(SPIRV-Tools-static PRIVATE ${source}/val/validation_state.h)
    endif()
endfunction()
cmake_language(DEFER CALL change_targets)
