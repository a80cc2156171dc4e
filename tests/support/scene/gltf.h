/* SPDX-License-Identifier: Apache-2.0 */
/*
 * gltf.h - a small glTF 2.0 scene: meshes of several materials, and nodes with matrices in a tree, some of which move.
 * Names are string literals, or outlive the scene. Parts with lines are written as LINES, those with radii alone as
 * POINTS, and radii as the attribute _RADIUS.
 *
 * For test programs only: a scene over the fixed limits, or without memory, ends the program.
 */
#ifndef BVHD_GLTF_H
#define BVHD_GLTF_H

#include <stdbool.h>

#include "tests/support/scene/mesh.h"

enum { GLTF_MAX_MATERIALS = 32, GLTF_MAX_PARTS = 4, GLTF_MAX_MESHES = 64, GLTF_MAX_IMAGES = 4, GLTF_MAX_MOTIONS = 16 };
enum { GLTF_NONE = -1 };

/* How texture coordinates follow from a vertex: by the two axes across its normal, or by longitude and latitude. */
enum gltf_mapping { GLTF_BY_FACES, GLTF_BY_SPHERE };

struct gltf_material {
    const char *name;
    float colour[3]; /* linear */
    bool is_smooth; /* its meshes have normals */
    int image; /* its texture + 1; 0: none */
    enum gltf_mapping mapping;
    double scale; /* of the coordinates of GLTF_BY_FACES: images on a side of length 1 */
    bool has_holes; /* where the image is transparent */
};

/* An image, rgba, in the curve of sRGB. */
struct gltf_image {
    unsigned width, height;
    unsigned char *pixels; /* owned by the scene */
};

struct gltf_mesh {
    const char *name;
    int part_count;
    int materials[GLTF_MAX_PARTS];
    struct mesh parts[GLTF_MAX_PARTS]; /* owned by the scene */
};

struct gltf_node {
    const char *name;
    int number; /* appended to the name when >= 0 */
    int mesh; /* index of a mesh, or GLTF_NONE */
    int parent; /* index of an earlier node, or GLTF_NONE for a root */
    double matrix[12]; /* row-major 3x4, to the parent's space */
};

/* Where a node is at a time. From one key to the next it moves in a straight line, and turns about one axis. */
struct gltf_key {
    double time; /* in seconds */
    double translation[3], rotation[4]; /* to the parent's space; the rotation is a quaternion x, y, z, w of length 1 */
};

/* How a node moves. */
struct gltf_motion {
    int node, key_count;
    struct gltf_key *keys; /* owned by the scene */
};

struct gltf {
    struct gltf_material materials[GLTF_MAX_MATERIALS];
    int material_count;
    struct gltf_image images[GLTF_MAX_IMAGES];
    int image_count;
    struct gltf_mesh meshes[GLTF_MAX_MESHES];
    int mesh_count;
    struct gltf_node *nodes;
    int node_count, node_capacity;
    struct gltf_motion motions[GLTF_MAX_MOTIONS];
    int motion_count;
};

/* Frees a scene. A zeroed scene is an empty one. Accepts NULL. */
void gltf_finish(struct gltf *gltf);

/* Each of these returns the index of what it added. */
int gltf_add_material(struct gltf *gltf, const char *name, double red, double green, double blue);
int gltf_add_mesh(struct gltf *gltf, const char *name);
int gltf_add_node(struct gltf *gltf, const struct gltf_node *node);

/* Lets a node move once, which counts instead of its matrix. The times of the keys ascend; the keys are copied. */
void gltf_move(struct gltf *gltf, int node, const struct gltf_key *keys, int count);

/* Adds an image that `paint` paints, pixel by pixel: u and v go from 0 to 1, from the upper left. */
int gltf_add_image(struct gltf *gltf, unsigned width, unsigned height,
                   void (*paint)(double u, double v, unsigned char ret_rgba[4]));

/* Adds an empty part to a mesh and returns it, to be filled. It is valid until gltf_finish. */
struct mesh *gltf_add_part(struct gltf *gltf, int mesh, int material);

/* The number of triangles of all nodes, each instance counted. */
uint64_t gltf_triangles(const struct gltf *gltf);

/*
 * Writes PATH, which must end in .gltf, and beside it a file of the same name with .bin, and images with .0.png and so
 * on. Returns 0, or -1 with errno set.
 */
int gltf_write(const struct gltf *gltf, const char *path);

#endif
