// SPDX-License-Identifier: Apache-2.0
// Reports an AABB as the closest hit.
#version 460
#extension GL_EXT_ray_tracing : require
#extension GL_GOOGLE_include_directive : require
#include "rays.glsl"

layout(location = 0) rayPayloadInEXT Hit hit;

void main()
{
    hit = Hit(gl_HitTEXT, 0, 0, gl_InstanceID, gl_InstanceCustomIndexEXT, gl_GeometryIndexEXT, gl_PrimitiveID, IS_AABB);
}
