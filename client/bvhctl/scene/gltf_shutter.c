/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_shutter.h"

#include <math.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_deform.h"
#include "client/bvhctl/scene/motion_fit.h"

enum { LAST = MOTION_FIT_STEPS, NO_PATH = -1 };

/* A mesh whose vertices move. */
struct moving_mesh {
    uint32_t mesh; /* of the import */
    float *rest; /* xyz each, at rest */
    float *end; /* at the end of the interval */
};

struct shutter {
    struct gltf_file *file;
    struct gltf_pose *pose;
    const struct import_moment *interval;
    const struct gltf_forms *forms;
    const struct gltf_spot *spots;
    struct import *import;
    struct moving_mesh *meshes; /* those of one form follow each other */
    uint32_t mesh_count;
    struct import_mesh *scratch; /* meshes of one form at one time; as many as the largest form has */
    uint32_t *paths; /* of each node: its number among those that move and show something; NO_PATH: it is none */
    uint32_t path_count;
    struct gltf_matrix *worlds; /* of each of these, one for each step */
    double (*boxes)[2][3]; /* of each form, lowest and highest over both ends */
};

static double time_of(const struct shutter *shutter, int step)
{
    double share = (double)step / LAST;
    return step == LAST ? shutter->interval->end
                        : shutter->interval->time * (1 - share) + shutter->interval->end * share;
}

static void note_deviation(const struct shutter *shutter, double distance, int step, uint32_t which,
                           struct import_deviation *deviation)
{
    if (distance > deviation->distance)
        *deviation = (struct import_deviation){distance, time_of(shutter, step), which};
}

/* ---- vertices ---- */

/* Returns whether the animation can move the vertices of a form: by weights, or by the joints of a skin. */
static bool can_move(const struct shutter *shutter, const struct gltf_form *form)
{
    return form->is_own && (form->is_skinned || shutter->pose->nodes[form->first_node].weights);
}

static float *copy_positions(const struct shutter *shutter, const float *positions, uint32_t vertex_count)
{
    float *copy = memory_array(shutter->file->memory, (uint64_t)vertex_count + 1, 3 * sizeof *copy);
    if (copy)
        memcpy(copy, positions, vertex_count * 3 * sizeof *copy);
    return copy;
}

/* Lists the meshes whose vertices can move, as they are at rest. */
static enum bvhd_status list_meshes(struct shutter *shutter)
{
    uint64_t count = 0, most = 0;
    struct memory *memory = shutter->file->memory;
    for (uint32_t i = 0; i < shutter->forms->count; i++) {
        const struct gltf_form *form = &shutter->forms->items[i];
        count += can_move(shutter, form) ? form->mesh_count : 0;
        most = form->mesh_count > most ? form->mesh_count : most;
    }
    shutter->meshes = memory_array(memory, count + 1, sizeof *shutter->meshes);
    shutter->scratch = memory_array(memory, most + 1, sizeof *shutter->scratch);
    if (!shutter->meshes || !shutter->scratch)
        return gltf_no_memory(shutter->file);
    for (uint32_t i = 0; i < shutter->forms->count; i++) {
        const struct gltf_form *form = &shutter->forms->items[i];
        for (uint32_t k = 0; k < form->mesh_count && can_move(shutter, form); k++) {
            uint32_t mesh = form->first_mesh + k;
            float *rest = copy_positions(shutter, shutter->import->meshes[mesh].positions,
                                         shutter->import->meshes[mesh].vertex_count);
            if (!rest)
                return gltf_no_memory(shutter->file);
            shutter->meshes[shutter->mesh_count++] = (struct moving_mesh){mesh, rest, NULL};
        }
    }
    return BVHD_OK;
}

/* Notes how far vertices are from where they are between both ends. */
static void measure_mesh(const struct shutter *shutter, const struct moving_mesh *moving, int step, const float *there)
{
    struct import_mesh *mesh = &shutter->import->meshes[moving->mesh];
    const float *end = mesh->shape == IMPORT_TRIANGLES ? moving->end : mesh->positions;
    double share = (double)step / LAST, greatest = 0;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double square = 0;
        for (size_t k = 3 * i; k < 3 * i + 3; k++) {
            double off = (double)there[k] - ((double)mesh->positions[k] * (1 - share) + (double)end[k] * share);
            square += off * off;
        }
        greatest = square > greatest ? square : greatest;
    }
    note_deviation(shutter, sqrt(greatest), step, moving->mesh, &shutter->import->vertex_deviation);
}

/* Moves the meshes of a form to the time of the pose: from rest, to arrays of their own. */
static enum bvhd_status move_form(const struct shutter *shutter, const struct gltf_form *form, int step,
                                  struct moving_mesh *meshes)
{
    enum bvhd_status status = BVHD_OK;
    memset(shutter->scratch, 0, form->mesh_count * sizeof *shutter->scratch);
    for (uint32_t i = 0; i < form->mesh_count && !status; i++) {
        const struct import_mesh *mesh = &shutter->import->meshes[meshes[i].mesh];
        shutter->scratch[i].vertex_count = mesh->vertex_count;
        shutter->scratch[i].primitive_count = mesh->primitive_count;
        shutter->scratch[i].positions = copy_positions(shutter, meshes[i].rest, mesh->vertex_count);
        status = shutter->scratch[i].positions ? BVHD_OK : gltf_no_memory(shutter->file);
    }
    if (!status)
        status = gltf_deform(shutter->file, shutter->pose, form, shutter->scratch);
    for (uint32_t i = 0; i < form->mesh_count; i++) {
        if (!status && step == LAST) {
            meshes[i].end = shutter->scratch[i].positions;
            measure_mesh(shutter, &meshes[i], step, meshes[i].end);
            continue;
        }
        if (!status)
            measure_mesh(shutter, &meshes[i], step, shutter->scratch[i].positions);
        memory_free(shutter->file->memory, shutter->scratch[i].positions);
    }
    return status;
}

static enum bvhd_status move_forms(struct shutter *shutter, int step)
{
    enum bvhd_status status = BVHD_OK;
    struct moving_mesh *meshes = shutter->meshes;
    for (uint32_t i = 0; i < shutter->forms->count && !status; i++) {
        const struct gltf_form *form = &shutter->forms->items[i];
        if (step == 0)
            status = gltf_deform(shutter->file, shutter->pose, form, shutter->import->meshes + form->first_mesh);
        else if (can_move(shutter, form))
            status = move_form(shutter, form, step, meshes);
        meshes += can_move(shutter, form) ? form->mesh_count : 0;
    }
    return status;
}

/* Gives meshes the positions of the end of the interval, if these are others. */
static void take_ends(struct shutter *shutter)
{
    for (uint32_t i = 0; i < shutter->mesh_count; i++) {
        struct moving_mesh *moving = &shutter->meshes[i];
        struct import_mesh *mesh = &shutter->import->meshes[moving->mesh];
        bool is_still = !memcmp(moving->end, mesh->positions, mesh->vertex_count * 3 * sizeof *moving->end);
        bool is_kept = shutter->interval->is_for_updates && mesh->shape == IMPORT_TRIANGLES;
        if ((is_still && !is_kept) || !mesh->primitive_count)
            continue;
        if (mesh->shape != IMPORT_TRIANGLES) {
            mesh->counts.unmoved = 1;
            shutter->file->counts->unmoved++;
            continue;
        }
        mesh->end_positions = moving->end;
        moving->end = NULL;
        shutter->import->moving_meshes++;
    }
}

/* ---- instances ---- */

static bool has_path(const struct shutter *shutter, uint32_t instance)
{
    const struct gltf_spot *spot = &shutter->spots[instance];
    return !spot->is_still && shutter->pose->nodes[spot->node].moves;
}

/* Numbers the nodes that move and show something. */
static enum bvhd_status list_paths(struct shutter *shutter)
{
    struct memory *memory = shutter->file->memory;
    uint64_t count = shutter->file->lists[GLTF_NODES].count;
    shutter->paths = memory_array(memory, count + 1, sizeof *shutter->paths);
    if (!shutter->paths)
        return gltf_no_memory(shutter->file);
    memset(shutter->paths, NO_PATH, count * sizeof *shutter->paths);
    for (uint32_t i = 0; i < shutter->import->instance_count; i++)
        if (has_path(shutter, i) && shutter->paths[shutter->spots[i].node] == (uint32_t)NO_PATH)
            shutter->paths[shutter->spots[i].node] = shutter->path_count++;
    shutter->worlds = memory_array(memory, (uint64_t)shutter->path_count + 1, (LAST + 1) * sizeof *shutter->worlds);
    return shutter->worlds ? BVHD_OK : gltf_no_memory(shutter->file);
}

static void record_worlds(const struct shutter *shutter, int step)
{
    for (uint32_t i = 0; i < shutter->file->lists[GLTF_NODES].count; i++)
        if (shutter->paths[i] != (uint32_t)NO_PATH)
            shutter->worlds[(size_t)shutter->paths[i] * (LAST + 1) + (size_t)step] = shutter->pose->nodes[i].world;
}

/* Finds the box of a form, of the vertices that are finite. It is in the origin if there are none. */
static void find_box(const struct import_mesh *meshes, uint32_t count, double ret_box[2][3])
{
    for (size_t axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (uint32_t i = 0; i < 2 * count; i++) {
            const struct import_mesh *mesh = &meshes[i / 2];
            const float *positions = i % 2 ? mesh->end_positions : mesh->positions;
            for (size_t k = 0; positions && k < mesh->vertex_count; k++) {
                double at = positions[3 * k + axis];
                low = isfinite(at) && at < low ? at : low;
                high = isfinite(at) && at > high ? at : high;
            }
        }
        ret_box[0][axis] = low <= high ? low : 0;
        ret_box[1][axis] = low <= high ? high : 0;
    }
}

static enum bvhd_status find_boxes(struct shutter *shutter)
{
    shutter->boxes = memory_array(shutter->file->memory, (uint64_t)shutter->forms->count + 1, sizeof *shutter->boxes);
    if (!shutter->boxes)
        return gltf_no_memory(shutter->file);
    for (uint32_t i = 0; i < shutter->forms->count; i++) {
        const struct gltf_form *form = &shutter->forms->items[i];
        find_box(shutter->import->meshes + form->first_mesh, form->mesh_count, shutter->boxes[i]);
    }
    return BVHD_OK;
}

/* Finds the motion of an instance, whose form is still in the place of its bottom level. */
static void fit_instance(const struct shutter *shutter, uint32_t index)
{
    struct import *import = shutter->import;
    struct import_instance *instance = &import->instances[index];
    const struct gltf_spot *spot = &shutter->spots[index];
    const double(*box)[3] = (const double(*)[3])shutter->boxes[instance->bottom];
    const struct gltf_matrix *worlds = shutter->worlds + (size_t)shutter->paths[spot->node] * (LAST + 1);
    struct motion_path path;
    struct motion_fit fit;
    memcpy(path.low, box[0], sizeof path.low);
    memcpy(path.high, box[1], sizeof path.high);
    for (int step = 0; step <= LAST; step++)
        path.at[step] = spot->has_local ? gltf_matrix_product(&worlds[step], &spot->local) : worlds[step];
    instance->skipped = !motion_fit(&path, &fit);
    if (instance->skipped)
        return;
    note_deviation(shutter, fit.distance, fit.step, instance->name, &import->instance_deviation);
    if (fit.motion.kind == ORACLE_STILL && !shutter->interval->is_for_updates)
        return;
    fit.motion.kind = fit.motion.kind == ORACLE_STILL ? ORACLE_MATRIX : fit.motion.kind;
    import->motions[import->motion_count++] = fit.motion;
    instance->motion = import->motion_count;
}

static enum bvhd_status fit_instances(struct shutter *shutter)
{
    struct import *import = shutter->import;
    uint64_t count = 0;
    for (uint32_t i = 0; i < import->instance_count; i++)
        count += has_path(shutter, i);
    import->motions = memory_array(import->memory, count + 1, sizeof *import->motions);
    enum bvhd_status status = import->motions ? find_boxes(shutter) : gltf_no_memory(shutter->file);
    for (uint32_t i = 0; i < import->instance_count && !status; i++)
        if (has_path(shutter, i))
            fit_instance(shutter, i);
    return status;
}

/* ---- the interval ---- */

/* Goes through all times: the beginning and the end first, because those between are measured by them. */
static enum bvhd_status go_through(struct shutter *shutter)
{
    enum bvhd_status status = BVHD_OK;
    for (int i = 0; i <= LAST && !status; i++) {
        int step = i == 0 ? 0 : i == 1 ? LAST : i - 1;
        if (i > 0)
            gltf_pose_move(shutter->file, shutter->pose, time_of(shutter, step));
        record_worlds(shutter, step);
        status = move_forms(shutter, step);
    }
    return status;
}

enum bvhd_status gltf_shutter_apply(struct gltf_file *file, struct gltf_pose *pose,
                                    const struct import_moment *interval, const struct gltf_forms *forms,
                                    const struct gltf_spot *spots, struct import *import)
{
    struct shutter shutter = {
        .file = file, .pose = pose, .interval = interval, .forms = forms, .spots = spots, .import = import};
    import->is_shutter = true;
    import->end_time = interval->end;
    enum bvhd_status status = list_meshes(&shutter);
    if (!status)
        status = list_paths(&shutter);
    if (!status)
        status = go_through(&shutter);
    if (!status) {
        take_ends(&shutter);
        status = fit_instances(&shutter);
    }
    for (uint32_t i = 0; i < shutter.mesh_count; i++) {
        memory_free(file->memory, shutter.meshes[i].rest);
        memory_free(file->memory, shutter.meshes[i].end);
    }
    memory_free(file->memory, shutter.meshes);
    memory_free(file->memory, shutter.scratch);
    memory_free(file->memory, shutter.paths);
    memory_free(file->memory, shutter.worlds);
    memory_free(file->memory, shutter.boxes);
    return status;
}
