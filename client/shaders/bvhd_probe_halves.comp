// SPDX-License-Identifier: Apache-2.0
// bvhd_probe_halves.comp - converts halves with a byte's bits to floats, for vulkan_trace_traits.c.
#version 450

layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) writeonly buffer Floats { vec2 floats[]; };

void main()
{
    uint byte = gl_GlobalInvocationID.x;
    floats[byte] = unpackHalf2x16(byte | byte << 16);
}
