// SPDX-License-Identifier: Apache-2.0
// Does nothing: the payload is a miss until something is hit.
#version 460
#extension GL_EXT_ray_tracing : require

void main()
{
}
