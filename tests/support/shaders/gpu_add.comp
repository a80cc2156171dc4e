// SPDX-License-Identifier: Apache-2.0
// Adds a specialisation constant and a push constant to numbers, for tests of gpu.h.
#version 450

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint constant = 0u;
layout(set = 0, binding = 0, std430) readonly buffer From { uint from[]; };
layout(set = 0, binding = 1, std430) writeonly buffer To { uint to[]; };
layout(push_constant) uniform Push { uint count, addend; };

void main()
{
    uint i = gl_GlobalInvocationID.x;
    if (i < count)
        to[i] = from[i] + constant + addend;
}
