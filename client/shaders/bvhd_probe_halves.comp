// SPDX-License-Identifier: Apache-2.0
// What halves of a byte's bits are as floats: for gpu_halves.c.
#version 450

layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) writeonly buffer Floats { vec2 floats[]; };

void main()
{
    uint byte = gl_GlobalInvocationID.x;
    floats[byte] = unpackHalf2x16(byte | byte << 16);
}
