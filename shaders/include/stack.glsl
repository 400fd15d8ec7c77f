// The traversal stack: the newest eight entries in registers, older ones in blocks of four in
// memory.
//
// A private array would be simpler, but software devices make every access to one a chain of
// selects over all its elements: with 46 entries, traversal was 14 times slower. Memory is touched
// in loops alone, because a loop that no lane enters costs nothing where an `if` would run masked.
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

// Whether the stack has no room for a push in registers, or nothing there for a pop while memory has something. In one
// comparison, which are dear on software devices: where an entry is missing, the difference wraps.
bool is_unbalanced(Stack stack) {
    uint least = min(stack.blocks, 1u);
    return STACK_SPILLS && stack.count - least >= STACK_REGISTERS - least;
}

// Makes room for a push, and brings back what a pop will need.
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

// Pushes `entry` (a change of 1), pops the newest entry (-1), or does neither (0), and yields what was the newest. The
// stack is balanced before.
uint update_stack(inout Stack stack, int change, uint entry) {
    if (STACK_SPILLS) {
        stack.count = uint(max(int(stack.count) + change, 0));
    }
    bool pushes = change > 0;
    bool pops = change < 0;
    uint popped = stack.newer.x;
    uvec4 pushed_newer = uvec4(entry, stack.newer.xyz);
    uvec4 pushed_older = uvec4(stack.newer.w, stack.older.xyz);
    uvec4 popped_newer = uvec4(stack.newer.yzw, stack.older.x);
    uvec4 popped_older = uvec4(stack.older.yzw, TRAVERSAL_DONE);
    stack.newer = pushes ? pushed_newer : pops ? popped_newer : stack.newer;
    stack.older = pushes ? pushed_older : pops ? popped_older : stack.older;
    return popped;
}

#endif
