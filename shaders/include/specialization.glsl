// What a pipeline is built for: the host sets the specialization constants from the scene's features, and the driver
// removes the code of all that the scene does not need. A kernel that has more than a scene needs gives the same bits:
// the scene's data then say what is there. The constants are declared by build.rs from the table in src/constants.rs,
// which has their meanings; here is what follows from them.
#ifndef SPECIALIZATION_GLSL
#define SPECIALIZATION_GLSL
#include "constants.glsl"
#include "specialization_constants.glsl"

const bool EXPLICIT = INTEGRATOR == INTEGRATOR_EXPLICIT;
const bool MIS = INTEGRATOR == INTEGRATOR_MIS;

#endif
