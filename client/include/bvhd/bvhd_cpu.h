/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd_cpu.h - traces rays through serialized structures on the CPU: the closest hit or any hit, of one ray or of many
 * in a call.
 *
 * It needs no daemon, no device and no Vulkan headers: serialized structures are bytes, from bvhd_batch_result or from
 * a file. The portable target and the native target of lavapipe give the same answers.
 *
 *     bvhd_cpu_scene_create(&options, &scene, &error);              checks all bytes, once
 *     bvhd_cpu_scene_trace(scene, &trace, &error);                  rays in, hits out
 *     bvhd_cpu_scene_destroy(scene);
 *
 * The semantics are Vulkan's (Vulkan specification, Ray Traversal). A triangle is hit if tmin < t < tmax, an AABB if
 * the ray meets it in the closed interval. Triangles are decided with exact signs, which is watertight: no ray slips
 * between triangles that share an edge or a vertex, and none hits twice there. Answers do not depend on the order of
 * visits: of triangles at equal distances, to 32 significant bits, the one with the lowest (instance, geometry,
 * primitive) is reported.
 *
 * Spheres and linear swept spheres are hit where the ray enters them from outside, if tmin < t < tmax. A ray that
 * begins inside one, or gets inside through an end without a cap, does not hit it from there. They count as triangles
 * do for opacity, candidates and BVHD_CPU_RAY_SKIP_TRIANGLES, and have no back faces. Only portable structures have
 * them.
 *
 * What moves is met as it is at the ray's time, from 0 (the start of the motion) to 1 (the end). Each coordinate of a
 * triangle is then start * (1 - time) + end * time in float, each operation rounded once, so that meshes stay
 * watertight. A motion instance has its matrix of that time, whose numbers are computed in the same way; or those of
 * its scale, rotation and translation are, and the matrix is composed of them in double and rounded once. An instance
 * that has no inverse at that time, or a quaternion of zero, is not hit. The time counts in all structures that move,
 * also in one under a top level that does not.
 *
 * Threads: a scene is immutable once it is created. Any number of threads may trace through it at once, and a call uses
 * no thread but the caller's. Nothing is allocated during a trace.
 *
 * Errors are reported as in bvhd.h: a status, and in *ret_error (which may be NULL) the place and the reason.
 */
#ifndef BVHD_BVHD_CPU_H
#define BVHD_BVHD_CPU_H

#include <stddef.h>
#include <stdint.h>

#include <bvhd/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Scenes: one structure, or a top level with the bottom levels that it names ---- */

/* One structure, or a top level with the bottom levels that it names, ready to be traced. */
struct bvhd_cpu_scene;

/* The bytes of one serialized structure. */
struct bvhd_cpu_blob {
    const void *data; /* portable: aligned to 16 bytes, as the data of results and of malloc are */
    uint64_t size;
};

/* The structures of a scene. */
struct bvhd_cpu_scene_options {
    size_t struct_size; /* sizeof(struct bvhd_cpu_scene_options) */
    /*
     * The bottom levels and, last, the top level over them; or one bottom level alone. All have the same target. An
     * entry may be {NULL, 0} if no instance names it; the last one may not. Entries with the same `data` pointer are
     * checked once.
     */
    const struct bvhd_cpu_blob *blobs;
    uint32_t blob_count;
    uint32_t flags; /* 0 */
    /*
     * Which of the blobs a top level names. NULL: blobs[r] is row r, where rows are the handles that the request's
     * instances reference, each once, in the order of their first reference (bvhd_vulkan_rows computes them). The
     * library writes them as handles 1, 2, 3, ... Otherwise handles[i] is the handle of blobs[i], for
     * i < blob_count - 1: the number that the top level has among its serialized handles after a program or a loader
     * has replaced them. These numbers are all different, and not 0 unless the blob is {NULL, 0}.
     */
    const uint64_t *handles;
};

/*
 * Checks every byte of the blobs, which may come from an untrusted source, and makes a scene of them. It takes time in
 * proportion to their size.
 *
 * The blobs are borrowed: their bytes must stay readable and unchanged until bvhd_cpu_scene_destroy. (A scene over the
 * results of a batch keeps references to their blobs by bvhd_blob_ref, or the batch itself.) The arrays `blobs` and
 * `handles` are not needed after the call. On machines with AVX2 a portable scene also holds an unpacked copy of the
 * nodes and the corners of triangles, about 70 bytes a triangle, with which rays are faster.
 *
 * Fails with BVHD_CORRUPT if a blob is no valid structure; BVHD_INCOMPATIBLE if it has another version, or belongs to a
 * driver that this library does not know; BVHD_INVALID if an option is wrong, a blob is misaligned, or the blobs do not
 * belong together: another target than the last one, a top level that is not the last one, an instance that names a
 * blob which is missing. `where` is "blobs[3]: " with the place in that blob, or "options.", or "instances[5]". Also
 * BVHD_NO_MEMORY.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_create(const struct bvhd_cpu_scene_options *options,
                                                struct bvhd_cpu_scene **ret_scene, struct bvhd_error *ret_error);

/* Frees a scene, in which no thread may be tracing any more. NULL is allowed and does nothing. */
BVHD_API void bvhd_cpu_scene_destroy(struct bvhd_cpu_scene *scene);

/*
 * Gives the bounds of everything that can be hit, in the scene's space: minimum, maximum. They are zeros for a scene
 * without primitives.
 */
BVHD_API void bvhd_cpu_scene_bounds(const struct bvhd_cpu_scene *scene, float ret_bounds[6]);

/* ---- Rays and hits ---- */

/* Flags of a ray, with SPIR-V's values and meanings. */
enum {
    BVHD_CPU_RAY_OPAQUE = 0x1, /* all geometry counts as opaque; not together with NO_OPAQUE */
    BVHD_CPU_RAY_NO_OPAQUE = 0x2, /* no geometry counts as opaque */
    BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT = 0x4, /* any hit is the answer, not only the closest one */
    BVHD_CPU_RAY_CULL_BACK_FACING = 0x10, /* triangles; at most one of this, CULL_FRONT_FACING and SKIP_TRIANGLES */
    BVHD_CPU_RAY_CULL_FRONT_FACING = 0x20, /* triangles */
    BVHD_CPU_RAY_CULL_OPAQUE = 0x40, /* at most one of this, CULL_NO_OPAQUE, OPAQUE and NO_OPAQUE */
    BVHD_CPU_RAY_CULL_NO_OPAQUE = 0x80,
    BVHD_CPU_RAY_SKIP_TRIANGLES = 0x100, /* and spheres and linear swept spheres; not together with SKIP_AABBS */
    BVHD_CPU_RAY_SKIP_AABBS = 0x200,
};

/*
 * A ray, which starts at `origin`. It has the fields of struct bvhd_ray (bvhd_trace.h) in the same places, so that one
 * array serves both, if its reserved fields are 0.
 */
struct bvhd_cpu_ray {
    float origin[3];
    float tmin;
    /*
     * The direction need not have unit length. A ray hits nothing if its direction is zero, or if a component of its
     * origin or direction is not finite.
     */
    float direction[3];
    float tmax; /* may be infinite; nothing is hit unless tmin <= tmax */
    uint32_t flags; /* BVHD_CPU_RAY_ */
    uint32_t mask; /* bits 7 .. 0: an instance is skipped if its mask has none of these bits; 0xff hits all */
    float time; /* 0 .. 1: when it meets what moves; structures without motion ignore it */
    uint32_t reserved; /* 0 */
};

/* The indices of an instance and of a blob that are not there. */
#define BVHD_CPU_NO_INSTANCE UINT32_C(0xffffffff)
#define BVHD_CPU_NO_BLOB UINT32_C(0xffffffff)

/*
 * The answer to a ray. A ray that hits nothing has t = +infinity, instance = BVHD_CPU_NO_INSTANCE, blob =
 * BVHD_CPU_NO_BLOB, and 0 in all other fields. (A hit that is farther than FLT_MAX has an infinite t, too, but a blob.)
 * The first 32 bytes are those of struct bvhd_hit (bvhd_trace.h).
 */
struct bvhd_cpu_hit {
    float t; /* the point is origin + t * direction */
    /*
     * The point of a triangle is (1 - u - v) * v0 + u * v1 + v * v2. Of a linear swept sphere, u says how far the
     * sphere that touches the point has moved: 0 at the first end, 1 at the second. Both are 0 otherwise.
     */
    float u, v;
    uint32_t instance; /* its position among the instances of the top level; BVHD_CPU_NO_INSTANCE without a top level */
    uint32_t custom_index; /* instanceCustomIndex, 24 bits */
    uint32_t geometry; /* index in the bottom level */
    uint32_t primitive; /* index in the geometry */
    uint32_t flags; /* BVHD_CPU_HIT_ */
    uint32_t sbt_offset; /* instanceShaderBindingTableRecordOffset, 24 bits */
    uint32_t blob; /* the index in `blobs` of the bottom level that was hit; BVHD_CPU_NO_BLOB: nothing was hit */
    uint32_t record, instance_record; /* for the functions below, which find what else belongs to a hit */
};

enum {
    BVHD_CPU_HIT_FRONT_FACE = 0x1, /* always set for spheres and linear swept spheres, never for AABBs */
    BVHD_CPU_HIT_AABB = 0x2,
    BVHD_CPU_HIT_SPHERE = 0x4,
    BVHD_CPU_HIT_SWEPT_SPHERE = 0x8, /* a linear swept sphere */
};

/* ---- Candidates: decisions during the traversal ---- */

/* The decision about a candidate. Both bits together confirm it and end the ray with it. */
enum {
    BVHD_CPU_IGNORE = 0x0,
    BVHD_CPU_CONFIRM = 0x1, /* it is a hit: the answer, unless a closer one is found */
    BVHD_CPU_TERMINATE = 0x2, /* the ray ends: its answer is what has been confirmed so far */
};

/* A candidate and the ray that met it, with what Vulkan's ray queries tell of one. Later versions may add fields. */
struct bvhd_cpu_candidate {
    const void *ray; /* in the caller's array */
    uint64_t ray_index;
    /*
     * The hit that it would be. For an AABB, t is where the ray enters the box (tmin if it starts inside); a callback
     * that finds a surface inside sets t, and the candidate counts if t is within the ray's interval. Other fields
     * are not to be changed.
     */
    struct bvhd_cpu_hit *hit;
    float tmax; /* t of the closest hit that was confirmed so far; else the ray's tmax */
    uint32_t is_opaque; /* 1: an AABB that counts as opaque. Other opaque primitives are no candidates: they are hits */
    float object_origin[3], object_direction[3]; /* the ray in the space of the bottom level; t is the same there */
    /* The instance's transform at the ray's time, and its inverse: row-major 3x4; the identity without a top level */
    float object_to_world[12], world_to_object[12];
};

/*
 * Decides about a candidate: returns bits of BVHD_CPU_CONFIRM and BVHD_CPU_TERMINATE, or BVHD_CPU_IGNORE. It is called
 * by the thread that traces, for each AABB and for each other primitive that does not count as opaque, if it can still
 * be the answer, in any order. A primitive can be offered more than once, unless its geometry has
 * VK_GEOMETRY_NO_DUPLICATE_ANY_HIT_INVOCATION_BIT_KHR. `candidate` and what it points to are valid during the call.
 */
typedef uint32_t (*bvhd_cpu_candidate_function)(void *context, struct bvhd_cpu_candidate *candidate);

/* ---- Tracing ---- */

enum {
    BVHD_CPU_TRACE_ANY_HIT = 0x1, /* every ray has TERMINATE_ON_FIRST_HIT: for shadows and visibility */
    /*
     * Children are visited in the opposite order, which is slower. The answers are the same (with ANY_HIT: whether
     * there is one), so a program can check the traversal with it.
     */
    BVHD_CPU_TRACE_FLIP_ORDER = 0x2,
};

/* The work that rays caused. */
struct bvhd_cpu_counters {
    size_t struct_size; /* sizeof(struct bvhd_cpu_counters) */
    /* visited nodes, tested primitives, which may be boxes or spheres, entered instances; added to, not reset */
    uint64_t nodes, triangles, instances;
};

/* The rays of a call, and where their hits go. */
struct bvhd_cpu_trace {
    size_t struct_size; /* sizeof(struct bvhd_cpu_trace) */
    /*
     * The array of struct bvhd_cpu_ray. ray_size is how much of the struct the program knows: sizeof(struct
     * bvhd_cpu_ray), or 40 without the time, which then is 0. Ray i begins i * ray_stride bytes after the first, where
     * a ray_stride of 0 stands for ray_size: an array of a program's own structs that begin with a ray has their size
     * as its stride. The array may be NULL if ray_count is 0.
     */
    const void *rays;
    size_t ray_size, ray_stride;
    /*
     * The array of struct bvhd_cpu_hit; hit i belongs to ray i. hit_size is sizeof(struct bvhd_cpu_hit), or less if
     * only its first fields are wanted: a multiple of 4, where 4 gives an array of t alone. hit_stride is as
     * ray_stride. The hits may not overlap the rays.
     */
    void *hits;
    size_t hit_size, hit_stride;
    uint64_t ray_count;
    uint32_t flags; /* BVHD_CPU_TRACE_ */
    uint32_t reserved; /* 0 */
    bvhd_cpu_candidate_function candidate; /* NULL: all primitives are hits, AABBs where the ray enters them */
    void *context; /* for `candidate` */
    struct bvhd_cpu_counters *counters; /* may be NULL */
};

/*
 * Traces rays in the calling thread. Programs with several threads give each a part of the rays. Through
 * portable structures many rays in a call take less time than as many calls, the more so if neighbours in the array
 * begin near each other and have similar directions: give the pixels of a picture in tiles of 8 x 8, row by row, and
 * some thousand rays a call. Answers do not depend on it.
 *
 * Returns BVHD_INVALID if a field of *trace is wrong, in which case no ray is traced; or if a ray has a time outside of
 * 0 .. 1, unknown flags, flags that exclude each other, or a `reserved` that is not 0. The place is then
 * "rays[17].time", the hits of the rays before it have been written, and the others are unchanged.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_trace(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_trace *trace,
                                               struct bvhd_error *ret_error);

/*
 * Give the corners v0, v1, v2 of the triangle of a hit, exactly as built, in the space of its bottom level; with _at of
 * one that may move, at the time of the ray that hit it. Return BVHD_INVALID if the hit is not one of this scene, or is
 * no triangle; without _at, if the triangle moves; with it, if the time is not in 0 .. 1.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_corners(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                                 float ret_corners[3][3], struct bvhd_error *ret_error);
BVHD_API enum bvhd_status bvhd_cpu_scene_corners_at(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                                    float time, float ret_corners[3][3], struct bvhd_error *ret_error);

/*
 * Gives the ends of the linear swept sphere of a hit, exactly as built, in the space of its bottom level: of each the
 * centre and the radius. Those of a sphere are the same. There, the normal of the surface is the way to the point that
 * was hit from (1 - u) * end 0 + u * end 1. Returns BVHD_INVALID if the hit is not one of this scene, or is no sphere
 * and no linear swept sphere.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_ends(const struct bvhd_cpu_scene *scene, const struct bvhd_cpu_hit *hit,
                                              float ret_ends[2][4], struct bvhd_error *ret_error);

/*
 * Give the corners of a triangle without a hit: by its bottom level, the number of its geometry, and its number there.
 * A portable structure must have been built with ALLOW_DATA_ACCESS, for which its scene holds 4 bytes more for each
 * triangle; a native one does not tell its flags, and needs none. The positions and the places "geometry", "primitive"
 * and "time" of errors are those of bvhd_structure_positions and bvhd_structure_positions_at (bvhd_structure.h): what
 * moves needs the latter. Return BVHD_INVALID at the place "blob" for one that is no bottom level of this scene, or was
 * built without the flag.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_positions(const struct bvhd_cpu_scene *scene, uint32_t blob, uint32_t geometry,
                                                   uint32_t primitive, float ret_positions[3][3],
                                                   struct bvhd_error *ret_error);
BVHD_API enum bvhd_status bvhd_cpu_scene_positions_at(const struct bvhd_cpu_scene *scene, uint32_t blob,
                                                      uint32_t geometry, uint32_t primitive, float time,
                                                      float ret_positions[3][3], struct bvhd_error *ret_error);

/*
 * Give the transform of the instance that was hit, row-major 3x4, from the space of its bottom level to the scene's;
 * the identity without a top level; with _at of an instance that may move, at the time of the ray. Return BVHD_INVALID
 * if the hit is not one of this scene, or is a miss; without _at, if the instance moves; with it, if the time is not
 * in 0 .. 1.
 */
BVHD_API enum bvhd_status bvhd_cpu_scene_object_to_world(const struct bvhd_cpu_scene *scene,
                                                         const struct bvhd_cpu_hit *hit, float ret_matrix[12],
                                                         struct bvhd_error *ret_error);
BVHD_API enum bvhd_status bvhd_cpu_scene_object_to_world_at(const struct bvhd_cpu_scene *scene,
                                                            const struct bvhd_cpu_hit *hit, float time,
                                                            float ret_matrix[12], struct bvhd_error *ret_error);

#ifdef __cplusplus
}
#endif

#endif
