// A branch that costs nothing where no lane takes it.
#ifndef SKIPPABLE_IF_GLSL
#define SKIPPABLE_IF_GLSL

// An `if` as a loop of one turn at most. Software devices run both sides of an `if` under a mask, but leave a loop as
// soon as no lane is active in it. CONDITION is evaluated once.
#define SKIPPABLE_IF(CONDITION) for (bool taken = (CONDITION); taken; taken = false)

#endif
