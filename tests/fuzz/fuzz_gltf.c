/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A GLB or glTF text from anywhere: it is either an error with a place, or an import whose numbers are in range.
 *
 * Input: the file. What meshes look like is read of files with an odd number of bytes. Files whose number of bytes has
 * a two in it are read at a moment of their animation, which is in the last byte, and over a shutter interval if that
 * is odd. Points and lines are read of files whose number of bytes has a four, or an eight, in it.
 */
#include "tests/fuzz/fuzz.h"

#include <math.h>
#include <sys/mman.h>
#include <unistd.h>

#include "client/bvhctl/scene/gltf.h"
#include "client/bvhctl/scene/import_round.h"
#include "tests/support/scene/scene_case.h"

static void check_meshes(const struct import *import)
{
    uint64_t primitives = 0;
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        FUZZ_CHECK(mesh->name && mesh->material && mesh->positions && mesh->indices);
        FUZZ_CHECK(mesh->shape < IMPORT_SHAPES && (mesh->shape == IMPORT_TRIANGLES || mesh->radii));
        for (uint64_t k = 0; k < import_corner_count(mesh); k++)
            FUZZ_CHECK(mesh->indices[k] < mesh->vertex_count);
        for (uint64_t k = 0; k < mesh->vertex_count && mesh->radii; k++)
            FUZZ_CHECK(mesh->radii[k] >= 0 && isfinite(mesh->radii[k]));
        for (uint64_t k = 0; k < mesh->primitive_count && mesh->shape == IMPORT_LINES; k++)
            FUZZ_CHECK(mesh->indices[2 * k + 1] == mesh->indices[2 * k] + 1 && mesh->caps[k] >= IMPORT_CAP_SECOND);
        primitives += mesh->primitive_count;
    }
    FUZZ_CHECK(primitives && primitives == import->triangle_count + import->point_count + import->line_count);
}

/* Reads all of an array, which shows the sanitizers whether it is there. */
static void touch(const float *array, uint64_t count)
{
    volatile float value;
    for (uint64_t i = 0; array && i < count; i++)
        value = array[i];
    (void)value;
}

static void check_looks(const struct import *import)
{
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        FUZZ_CHECK(!mesh->look.has_image || mesh->look.image < import->image_count);
        touch(mesh->look.normals, UINT64_C(3) * mesh->vertex_count);
        touch(mesh->look.texcoords, UINT64_C(2) * mesh->vertex_count);
        touch(mesh->look.colours, UINT64_C(4) * mesh->vertex_count);
    }
}

static void check_instances(const struct import *import)
{
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        FUZZ_CHECK(import->bottoms[i].name && import->bottoms[i].mesh_count);
        for (uint32_t k = 0; k < import->bottoms[i].mesh_count; k++)
            FUZZ_CHECK(import->bottoms[i].meshes[k] < import->mesh_count);
    }
    for (uint32_t i = 0; i < import->instance_count; i++) {
        FUZZ_CHECK(import->instances[i].bottom < import->bottom_count);
        FUZZ_CHECK(import->instances[i].motion <= import->motion_count);
        for (int k = 0; k < 12; k++)
            FUZZ_CHECK(import->instances[i].skipped || isfinite(import->instances[i].transform[k]));
    }
}

static void check_motion(const struct import *import)
{
    uint32_t moving = 0;
    for (uint32_t i = 0; i < import->motion_count; i++) {
        const struct import_motion *motion = &import->motions[i];
        FUZZ_CHECK(motion->kind == ORACLE_MATRIX || motion->kind == ORACLE_SRT);
        for (int k = 0; k < (motion->kind == ORACLE_SRT ? 16 : 12); k++)
            FUZZ_CHECK(isfinite(motion->start[k]) && isfinite(motion->end[k]));
    }
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        FUZZ_CHECK(!mesh->end_positions || (import->is_shutter && mesh->shape == IMPORT_TRIANGLES));
        touch(mesh->end_positions, UINT64_C(3) * mesh->vertex_count);
        moving += mesh->end_positions != NULL;
    }
    FUZZ_CHECK(moving == import->moving_meshes && (import->is_shutter || import->motion_count == 0));
    FUZZ_CHECK(isfinite(import->instance_deviation.distance) && isfinite(import->vertex_deviation.distance));
    FUZZ_CHECK(import->instance_deviation.which == 0 || import->instance_deviation.which < import->node_names.size);
    FUZZ_CHECK(import->vertex_deviation.distance == 0 || import->vertex_deviation.which < import->mesh_count);
}

/* Puts the input into a file in memory. It stays open, because making one takes a seventh of the time of an input. */
static void write_input(const uint8_t *data, size_t size, char ret_path[64])
{
    static int descriptor = -1;
    if (descriptor < 0)
        descriptor = memfd_create("fuzz", MFD_CLOEXEC);
    FUZZ_CHECK(descriptor >= 0 && ftruncate(descriptor, 0) == 0);
    FUZZ_CHECK(pwrite(descriptor, data, size, 0) == (ssize_t)size);
    snprintf(ret_path, 64, "/proc/self/fd/%d", descriptor);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char path[64];
    const char *foreign;
    struct memory memory;
    struct import_files files;
    struct bvhd_error error = {0};
    write_input(data, size, path);
    memory_init(&memory, UINT64_C(1) << 26);
    import_files_init(&files, &memory);
    struct import import = {.memory = &memory, .wants_looks = size % 2};
    const uint8_t last = size ? data[size - 1] : 0;
    const struct import_moment moment = {
        .time = last / 64.0, .is_shutter = last % 2, .end = last / 64.0 + 0.5, .is_for_updates = last % 4 == 3};
    const struct import_wish wish = {
        .moment = size & 2 ? &moment : NULL, .point_radius = size & 4 ? 0.5f : 0, .line_radius = size & 8 ? 0.25f : 0};
    enum bvhd_status status = gltf_read(path, &wish, &files, &import, &foreign, &error);
    if (status) {
        FUZZ_CHECK(error.status == status && error.where[0] && error.text[0]);
    } else if (!foreign) {
        check_meshes(&import);
        check_looks(&import);
        check_instances(&import);
        check_motion(&import);
    }
    import.files = files.paths;
    import.file_count = files.count;
    import_finish(&import);
    FUZZ_CHECK(memory.live == 0);
    return 0;
}

/* All cases of the table, each as it is, and with spaces behind it, so that it is read over a shutter interval. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    _Static_assert((int)SCENE_CASE_ROOM <= (int)FUZZ_ROOM, "a case is a sample");
    size_t size = scene_case_sample("glTF", index / 2, ret_bytes);
    if (!size || index % 2 == 0 || size + 4 > FUZZ_ROOM)
        return size;
    do
        ret_bytes[size++] = '\t';
    while (!(size & 2));
    return size;
}
