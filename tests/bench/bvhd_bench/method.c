/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/method.h"

#include <string.h>

#define OWN(quality_, name_)                                                                                           \
    {.name = name_, .label = name_, .kind = METHOD_OWN, .quality = quality_, .target = TARGET_PORTABLE},               \
        {.name = name_ "/fast-triangles",                                                                              \
         .label = name_ " 48 B",                                                                                       \
         .kind = METHOD_OWN,                                                                                           \
         .quality = quality_,                                                                                          \
         .target = TARGET_PORTABLE,                                                                                    \
         .layout_flags = PORTABLE_FAST_TRIANGLES},                                                                     \
        {.name = name_ "/embree",                                                                                      \
         .label = name_ " by Embree",                                                                                  \
         .kind = METHOD_OWN,                                                                                           \
         .quality = quality_,                                                                                          \
         .builder = BUILDER_EMBREE,                                                                                    \
         .target = TARGET_PORTABLE},                                                                                   \
    {                                                                                                                  \
        .name = name_ "/lavapipe", .label = name_ " lavapipe", .kind = METHOD_OWN, .quality = quality_,                \
        .target = TARGET_LAVAPIPE                                                                                      \
    }
#define AUTO(rays_, text_)                                                                                             \
    {                                                                                                                  \
        .name = "auto-" text_, .label = "auto " text_, .kind = METHOD_OWN, .quality = QUALITY_AUTO,                    \
        .target = TARGET_PORTABLE, .rays_per_primitive = rays_                                                         \
    }
#define BVH(effort_, arity_, name_)                                                                                    \
    {                                                                                                                  \
        .name = "embree/bvh-" name_, .label = "BVH " name_, .kind = METHOD_BVH, .effort = effort_, .arity = arity_     \
    }
#define SCENE(effort_, robust_, compact_, name_)                                                                       \
    {                                                                                                                  \
        .name = "embree/scene-" name_, .label = "Embree " name_, .kind = METHOD_SCENE, .effort = effort_,              \
        .robust = robust_, .compact = compact_                                                                         \
    }

static const struct method methods[] = {
    OWN(QUALITY_FAST, "fast"),
    OWN(QUALITY_BALANCED, "balanced"),
    OWN(QUALITY_HIGH, "high"),
    AUTO(0.1f, "0.1"),
    AUTO(1, "1"),
    AUTO(10, "10"),
    AUTO(100, "100"),
    {.name = "sweep", .label = "full sweep", .kind = METHOD_SWEEP, .arity = 2},
    BVH(EFFORT_LOW, 2, "low-2"),
    BVH(EFFORT_MEDIUM, 2, "medium-2"),
    BVH(EFFORT_HIGH, 2, "high-2"),
    BVH(EFFORT_LOW, 8, "low-8"),
    BVH(EFFORT_MEDIUM, 8, "medium-8"),
    SCENE(EFFORT_LOW, false, false, "low"),
    SCENE(EFFORT_MEDIUM, false, false, "medium"),
    SCENE(EFFORT_HIGH, false, false, "high"),
    SCENE(EFFORT_MEDIUM, false, true, "medium-compact"),
    SCENE(EFFORT_LOW, true, false, "low-robust"),
    SCENE(EFFORT_MEDIUM, true, false, "medium-robust"),
    SCENE(EFFORT_HIGH, true, false, "high-robust"),
    SCENE(EFFORT_MEDIUM, true, true, "medium-compact-robust"),
};

const struct method *method_all(uint32_t *ret_count)
{
    *ret_count = sizeof methods / sizeof methods[0];
    return methods;
}

const struct method *method_find(const char *name)
{
    for (size_t i = 0; i < sizeof methods / sizeof methods[0]; i++)
        if (strcmp(methods[i].name, name) == 0)
            return &methods[i];
    return NULL;
}

bool method_traces(const struct method *method)
{
    return method->kind == METHOD_OWN || method->kind == METHOD_SCENE;
}

bool method_has_tree(const struct method *method)
{
    return method->kind != METHOD_SCENE;
}
