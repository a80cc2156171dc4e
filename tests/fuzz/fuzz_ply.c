/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_ply.c - fuzzes the reader of PLY files: the result is either an error with a place and a text, or an import
 * whose indices are in range. Memory is bounded by the size of the file.
 *
 * The input is the file. Points and lines are read of files with an odd number of bytes.
 */
#include "tests/fuzz/fuzz.h"

#include <float.h>

#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/ply.h"
#include "tests/support/scene/scene_case.h"

static void check_mesh(const struct import_mesh *mesh)
{
    for (uint64_t i = 0; i < import_corner_count(mesh); i++)
        FUZZ_CHECK(mesh->indices[i] < mesh->vertex_count);
    volatile float position; /* reading all positions shows the sanitizers whether they are there */
    for (uint64_t i = 0; i < 3 * (uint64_t)mesh->vertex_count; i++)
        position = mesh->positions[i];
    for (uint64_t i = 0; i < mesh->vertex_count && mesh->radii; i++)
        FUZZ_CHECK(mesh->radii[i] >= 0 && mesh->radii[i] <= FLT_MAX);
    (void)position;
}

static void check_import(const struct import *import)
{
    FUZZ_CHECK(import->mesh_count <= IMPORT_SHAPES && import->bottom_count <= import->mesh_count);
    FUZZ_CHECK(import->bottom_count > 0 && import->instance_count == import->bottom_count);
    for (uint32_t i = 0; i < import->mesh_count; i++)
        check_mesh(&import->meshes[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    if (size == 0)
        return 0;
    FILE *file = fmemopen((void *)(uintptr_t)data, size, "rb");
    FUZZ_CHECK(file);
    memory_init(&memory, UINT64_MAX);
    const struct import_wish wish = {.point_radius = size & 1 ? 0.5f : 0, .line_radius = size & 1 ? 0.25f : 0};
    enum bvhd_status status = ply_import_stream(file, size, "x.ply", &wish, &memory, &import, &error);
    fclose(file);
    if (status == BVHD_OK) {
        check_import(&import);
        import_finish(&import);
    } else {
        FUZZ_CHECK(status == BVHD_INVALID || status == BVHD_UNSUPPORTED);
        FUZZ_CHECK(error.status == status && error.where[0] && error.text[0]);
    }
    FUZZ_CHECK(memory.live == 0 && memory.peak <= 100 * size + 400000);
    return 0;
}

/* All cases of the table. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    _Static_assert((int)SCENE_CASE_ROOM <= (int)FUZZ_ROOM, "a case is a sample");
    return scene_case_sample("PLY", index, ret_bytes);
}
