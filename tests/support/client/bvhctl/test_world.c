/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/bvhctl/test_world.h"
#include "tests/support/builder/builders.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char ground_name[] = "ground", cube_name[] = "cube", material_name[] = "stone", world_name[] = "world",
            file_name[] = "world.gltf";

static float ground_positions[] = {-8, 0, -8, 8, 0, -8, 8, 0, 8, -8, 0, 8};
static uint32_t ground_indices[] = {0, 2, 1, 0, 3, 2};

/* The x, y, z of corner i are bits 0, 1, 2 of i. */
static float cube_positions[] = {-1, -1, -1, 1, -1, -1, -1, 1, -1, 1, 1, -1, -1, -1, 1, 1, -1, 1, -1, 1, 1, 1, 1, 1};
static uint32_t cube_indices[] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                  2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};

static struct import_mesh meshes[] = {
    {.name = ground_name,
     .material = material_name,
     .positions = ground_positions,
     .indices = ground_indices,
     .vertex_count = 4,
     .primitive_count = 2},
    {.name = cube_name,
     .material = material_name,
     .positions = cube_positions,
     .indices = cube_indices,
     .vertex_count = 8,
     .primitive_count = 12},
};

static uint32_t ground_list[] = {0}, cube_list[] = {1};
static struct import_bottom bottoms[] = {{ground_name, ground_list, 1}, {cube_name, cube_list, 1}};

static struct import_instance instances[TEST_WORLD_INSTANCES] = {
    {0, 0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, false, 0},
    {1, 0, {1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 0}, false, 0},
    {1, 0, {1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0}, true, 0},
    {1, 0, {0.5f, 0, 0, 3, 0, 0.5f, 0, 0.5f, 0, 0, 0.5f, 0}, false, 0},
};

static char *files[] = {file_name};

void test_world_place(uint32_t instance, const float object_to_world[12])
{
    memcpy(instances[instance].transform, object_to_world, sizeof instances[instance].transform);
}

void test_world_import(struct import *ret_import, struct memory *memory)
{
    *ret_import = (struct import){.name = world_name,
                                  .meshes = meshes,
                                  .bottoms = bottoms,
                                  .instances = instances,
                                  .files = files,
                                  .mesh_count = 2,
                                  .bottom_count = 2,
                                  .instance_count = TEST_WORLD_INSTANCES,
                                  .file_count = 1,
                                  .skipped_instances = 1,
                                  .triangle_count = 14,
                                  .memory = memory};
}

static void end(const char *what, const struct bvhd_error *error)
{
    fprintf(stderr, "test_world: %s: %s: %s\n", what, error->where, error->text);
    exit(1);
}

void test_world_init(struct test_world *world, uint32_t threads)
{
    test_world_init_for(world, threads, NULL);
}

/* Builds and opens the import of a world whose options are set. */
static void build_world(struct test_world *world, uint32_t threads, const struct import *import)
{
    struct bvhd_error error = {0};
    if (local_open(&world->local, threads, UINT64_MAX, &error) != BVHD_OK)
        end("open", &error);
    if (backend_local_open(&world->backend, threads, &world->local.memory, &world->local.progress, &error) != BVHD_OK)
        end("open", &error);
    world->import = *import;
    world->import.memory = &world->local.memory;
    if (assemble(&world->import, &world->options, &world->backend.backend, &world->assembly, &error) != BVHD_OK)
        end("assemble", &error);
    struct memory *memory = &world->local.memory;
    uint32_t count = import->bottom_count + 1;
    struct structure_file *opened = memory_array(memory, count, sizeof *opened);
    if (!opened)
        end("open", &error);
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_result *item = &world->assembly.items[i];
        if (item->error.status != BVHD_OK)
            end("build", &item->error);
        opened[i] = (struct structure_file){.size = item->size};
        if (structure_open((struct bytes){item->data, item->size}, memory, &opened[i].structure, &error) != BVHD_OK)
            end("open", &error);
    }
    world->structures = (struct structures){.files = opened, .file_count = count, .has_top = true, .memory = memory};
    if (structures_join(&world->structures, &error) != BVHD_OK)
        end("join", &error);
}

void test_world_init_for(struct test_world *world, uint32_t threads, const struct bvhd_format *format)
{
    struct import import;
    *world = (struct test_world){.options = {.build = {.target = format ? (enum target)format->target : TARGET_PORTABLE,
                                                       .builder = builders_asked()},
                                             .format = format,
                                             .geometry_flags = GEOMETRY_OPAQUE}};
    test_world_import(&import, NULL);
    build_world(world, threads, &import);
}

void test_world_init_from(struct test_world *world, uint32_t threads, const struct import *import)
{
    *world = (struct test_world){.options = {.build = {.target = TARGET_PORTABLE, .builder = builders_asked()},
                                             .geometry_flags = GEOMETRY_OPAQUE}};
    build_world(world, threads, import);
}

void test_world_finish(struct test_world *world)
{
    structures_close(&world->structures);
    assembly_finish(&world->assembly);
    backend_local_close(&world->backend);
    local_close(&world->local);
}
