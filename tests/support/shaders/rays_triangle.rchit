// SPDX-License-Identifier: Apache-2.0
// Reports a triangle as the closest hit.
#version 460
#extension GL_EXT_ray_tracing : require
#extension GL_GOOGLE_include_directive : require
#include "rays.glsl"

layout(location = 0) rayPayloadInEXT Hit hit;
hitAttributeEXT vec2 barycentrics;

void main()
{
    uint flags = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT ? FRONT_FACE : 0u;
    hit = Hit(gl_HitTEXT, barycentrics.x, barycentrics.y, gl_InstanceID, gl_InstanceCustomIndexEXT, gl_GeometryIndexEXT,
              gl_PrimitiveID, flags);
}
