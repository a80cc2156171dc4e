// SPDX-License-Identifier: Apache-2.0
// Computes for some milliseconds, so that a device that has been idle raises its clock.
#version 450
layout(local_size_x = 256) in;
layout(set = 0, binding = 0, std430) buffer Out { float value[]; };
layout(push_constant) uniform Push { uint rounds; };

void main()
{
    float x = float(gl_GlobalInvocationID.x) * 1e-6;
    for (uint i = 0u; i < rounds; i++)
        x = fma(x, 0.999999, 0.5 * x * x);
    if (x == 123.0)
        value[0] = x;
}
