// The traversal stack: the newest eight entries in registers, older ones in blocks of four in
// memory.
//
// A private array would be simpler, but software devices make every access to one a chain of
// selects over all its elements: with 46 entries, traversal was 14 times slower. Memory is accessed
// only in loops, because a loop in which no lane is active costs nothing where an `if` would run masked.
#ifndef STACK_GLSL
#define STACK_GLSL
#include "workgroup.glsl"
#include "specialization.glsl"
#include "bindings_scene.glsl"

// Blocks that left the registers: the first ones of all invocations of the launch, the second ones, and so on.
layout(set = 1, binding = 11, std430) buffer StackBlocks { uvec4 entries[]; } stack_blocks;

const bool STACK_SPILLS = STACK_SIZE > STACK_REGISTERS;

struct Stack {
    uvec4 newer;   // newest entry first
    uvec4 older;
    uint count;    // entries in registers
    uint blocks;   // in memory
};

// An empty stack yields TRAVERSAL_DONE.
Stack empty_stack() { return Stack(uvec4(TRAVERSAL_DONE), uvec4(TRAVERSAL_DONE), 0u, 0u); }

uint block_place(uint block) { return block * gl_NumWorkGroups.x * gl_WorkGroupSize.x + gl_GlobalInvocationID.x; }

// Whether the stack has no room for a push in registers, or nothing there for a pop while memory has something. A single
// comparison (they are expensive on software devices): the difference wraps where an entry is missing.
bool is_unbalanced(Stack stack) {
    uint least = min(stack.blocks, 1u);
    return STACK_SPILLS && stack.count - least >= STACK_REGISTERS - least;
}

// Makes room for a push, and brings back from memory what a pop will need.
void balance_stack(inout Stack stack) {
    while (STACK_SPILLS && stack.count == STACK_REGISTERS) {
        stack_blocks.entries[block_place(stack.blocks)] = stack.older;
        stack.blocks += 1u;
        stack.count -= STACK_BLOCK;
    }
    while (STACK_SPILLS && stack.count == 0u && stack.blocks > 0u) {
        stack.blocks -= 1u;
        stack.newer = stack_blocks.entries[block_place(stack.blocks)];
        stack.count = STACK_BLOCK;
    }
}

// Pushes an entry if `pushes`. The stack is balanced before.
void push_if(bool pushes, uint entry, inout Stack stack) {
    if (STACK_SPILLS) {
        stack.count += uint(pushes);
    }
    uvec4 newer = uvec4(entry, stack.newer.xyz);
    uvec4 older = uvec4(stack.newer.w, stack.older.xyz);
    stack.newer = pushes ? newer : stack.newer;
    stack.older = pushes ? older : stack.older;
}

// Yields the newest entry and pops it if `pops`. The stack is balanced before.
uint pop_if(bool pops, inout Stack stack) {
    uint newest = stack.newer.x;
    if (STACK_SPILLS) {
        stack.count -= min(stack.count, uint(pops));
    }
    uvec4 newer = uvec4(stack.newer.yzw, stack.older.x);
    uvec4 older = uvec4(stack.older.yzw, TRAVERSAL_DONE);
    stack.newer = pops ? newer : stack.newer;
    stack.older = pops ? older : stack.older;
    return newest;
}

#endif
