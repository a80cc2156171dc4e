/* SPDX-License-Identifier: Apache-2.0 */
/*
 * manifest.h - writes and reads manifest.json, which lists the structures in a directory: their files, their targets,
 * and which bottom levels a top level refers to.
 *
 * docs/manifest.md describes its members. It contains no times, so that it is the same for equal input on any machine,
 * with any number of threads. `file` is a plain name in the directory, and handles of a top level are files, in the
 * order of its serialized handles.
 */
#ifndef BVHCTL_MANIFEST_H
#define BVHCTL_MANIFEST_H

#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/scene/built.h"
#include "client/bvhctl/scene/file_names.h"
#include "client/bvhctl/base/json.h"

#define MANIFEST_NAME "manifest.json"

enum { MANIFEST_REVISION = 2 };

/* Returns the name of what was done for a structure: "built", "updated", "lost", "other_active" or "decayed". */
const char *manifest_method_name(enum assembly_method method);

/* Begins a manifest: the array of its structures is open then. */
void manifest_begin(struct json *json, const struct options *options);

/*
 * Writes one element of "structures". With `times` it has also the members that depend on the run: times, peak memory,
 * cache hits; without, a top level has the nodes.
 */
void manifest_write_structure(struct json *json, const struct assembly *assembly, uint32_t index,
                              const struct file_names *names, bool times);

/*
 * Writes one element of "scenes", for a scene whose top level was built. The scene's files are read for their
 * checksums.
 */
void manifest_write_scene(struct json *json, const struct assembly *assembly, const struct file_names *names);

/* Writes the members "points" and "lines", the numbers of those that were read; nothing for those that are 0. */
void manifest_write_round_counts(struct json *json, const struct import *import);

/* Writes the member "left_out", with the kinds of which there is some; nothing if there is none. */
void manifest_write_left_out(struct json *json, const struct import_counts *counts);

/* Writes the member "left_out_options": the options by which some of that is read; nothing if there are none. */
void manifest_write_left_out_options(struct json *json, const struct import_counts *counts);

/* Ends a manifest, with the elements of "scenes". */
void manifest_end(struct json *json, const struct json *scenes);

/* Returns the member "name" of structure `index`: that of its mesh or node, or that of the scene. */
const char *manifest_structure_name(const struct import *import, uint32_t index);

/* The base colour of a geometry, linear. It has none if red < 0. */
struct manifest_colour {
    float rgb[3];
};

struct manifest_entry {
    char *file, *scene, *name;
    char *key; /* as text; "" if the manifest has none */
    enum target target;
    bool is_top;
    uint64_t bytes; /* 0: the manifest does not say how large it is */
    bool has_source; /* it was built from one chosen scene of its file: */
    uint32_t source_number; /* its number, from 0 */
    char *source_name; /* and its name; NULL if it has none */
    bool has_moment; /* it was built at a moment of an animation of its file: */
    double moment; /* in seconds */
    bool is_shutter; /* and from there over a shutter interval: */
    double end; /* in seconds */
    bool is_updatable; /* it was built with allow-update */
    bool has_animation; /* the file had one: */
    uint32_t animation; /* its number, from 0 */
    float point_radius, line_radius; /* of its points and lines that have none in its file; 0: they were left out */
    char *source_file; /* of a top level: the name of the scene's file, without its folder; NULL if it is not known */
    char **handles; /* of a top level: files, in the order of its handles */
    uint32_t handle_count;
    struct manifest_colour *colours; /* one for each geometry */
    uint32_t colour_count;
};

/* The options of the build, as far as they decide what structures are. */
struct manifest_options {
    bool are_known; /* the manifest has them, and this version knows each: */
    struct build_options build; /* without a device's format */
    uint32_t build_flags, geometry_flags;
    double rays; /* 0: not given */
};

struct manifest {
    struct manifest_entry *entries;
    uint32_t count;
    struct manifest_options options;
    struct memory *memory;
};

/*
 * Reads the manifest of a directory or a container, which is hostile: file names that contain '/' or are ".." are
 * refused. Nodes are not read. BVHD_NOT_FOUND, or BVHD_CORRUPT with the place, or the errors of built_open. End with
 * manifest_finish.
 */
enum bvhd_status manifest_read(const char *path, struct memory *memory, struct manifest *ret_manifest,
                               struct bvhd_error *error);
enum bvhd_status manifest_read_built(const struct built *built, struct memory *memory, struct manifest *ret_manifest,
                                     struct bvhd_error *error);

/* The files of the nodes of a top level, in the order of its instances. */
struct manifest_nodes {
    char **files;
    uint32_t count;
    struct memory *memory;
};

/*
 * Reads the nodes of the top level whose file is `top`. It takes several times the memory of their text. Errors as
 * those of manifest_read. End with manifest_nodes_finish.
 */
enum bvhd_status manifest_read_nodes(const char *path, const char *top, struct memory *memory,
                                     struct manifest_nodes *ret_nodes, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void manifest_nodes_finish(struct manifest_nodes *nodes);

/*
 * Finds the top level that `scene` names: the scene of this name, else the one that was built from the scene of this
 * name or number in its file. If several files have one, it is that of the file named `file`, which may be NULL. NULL:
 * there is none, or it is not clear which.
 */
const struct manifest_entry *manifest_find_top(const struct manifest *manifest, const char *file, const char *scene);

/* How the scene of a top level is read from its file again. It points into itself, so that it must not be moved. */
struct manifest_wish {
    struct import_wish wish;
    struct import_moment moment;
    char scene[16], animation[16]; /* numbers */
};

void manifest_wish_init(struct manifest_wish *wish, const struct manifest_entry *top);

/* NULL-safe, idempotent. */
void manifest_finish(struct manifest *manifest);

/*
 * Returns the name of the quality that was built: "fast", "balanced" or "high". It is "" for a quality that only a
 * newer service knows, and for results of an older service, which do not contain it.
 */
const char *manifest_quality_name(enum bvhd_quality quality);

#endif
