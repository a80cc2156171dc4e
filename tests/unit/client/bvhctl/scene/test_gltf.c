/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf.c - tests that each feature of glTF is read right or refused by name, by a table of generated files. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/scene/import.h"
#include "tests/support/scene/gltf_case.h"
#include "tests/support/scratch.h"

/* A new file each time: some file systems write a file to the disk at once that replaces its bytes. */
static void write_file(const char *path, const void *data, size_t size)
{
    unlink(path);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    fclose(file);
}

/* The matrix of 16 numbers of an SRT, by a point that is scaled, turned by two products of quaternions, and moved. */
static void turn(const float srt[16], const double at[3], double ret[3])
{
    const double q[3] = {srt[9], srt[10], srt[11]}, w = srt[12],
                 square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + w * w;
    const double p[3] = {srt[0] * at[0] + srt[1] * at[1] + srt[2] * at[2] + srt[3],
                         srt[4] * at[1] + srt[5] * at[2] + srt[6], srt[7] * at[2] + srt[8]};
    double c[3];
    for (int i = 0; i < 3; i++)
        c[i] = q[(i + 1) % 3] * p[(i + 2) % 3] - q[(i + 2) % 3] * p[(i + 1) % 3] + w * p[i];
    for (int i = 0; i < 3; i++)
        ret[i] = p[i] + 2 * (q[(i + 1) % 3] * c[(i + 2) % 3] - q[(i + 2) % 3] * c[(i + 1) % 3]) / square + srt[13 + i];
}

/* Returns where a point of an instance is at one end of the shutter interval. */
static void move(const struct import *import, const struct import_instance *instance, bool at_end, const double at[3],
                 double ret[3])
{
    const struct import_motion *motion = instance->motion && at_end ? &import->motions[instance->motion - 1] : NULL;
    const float *row = motion ? motion->end : instance->transform;
    for (int axis = 0; axis < 3; axis++)
        ret[axis] = row[4 * axis] * at[0] + row[4 * axis + 1] * at[1] + row[4 * axis + 2] * at[2] + row[4 * axis + 3];
    if (motion && motion->kind == ORACLE_SRT)
        turn(motion->end, at, ret);
}

/* Extends bounds by the corners of all triangles of an instance, at one end of the shutter interval. */
static void extend(const struct import *import, const struct import_instance *instance, bool at_end, double low[3],
                   double high[3])
{
    const struct import_bottom *bottom = &import->bottoms[instance->bottom];
    for (uint32_t m = 0; m < bottom->mesh_count; m++) {
        const struct import_mesh *mesh = &import->meshes[bottom->meshes[m]];
        for (uint32_t i = 0; i < 3 * mesh->primitive_count; i++) {
            assert_true(mesh->indices[i] < mesh->vertex_count);
            const float *at =
                (mesh->end_positions && at_end ? mesh->end_positions : mesh->positions) + 3 * (size_t)mesh->indices[i];
            double point[3];
            move(import, instance, at_end, (const double[3]){at[0], at[1], at[2]}, point);
            for (int axis = 0; axis < 3; axis++) {
                low[axis] = point[axis] < low[axis] ? point[axis] : low[axis];
                high[axis] = point[axis] > high[axis] ? point[axis] : high[axis];
            }
        }
    }
}

static void check_bounds(const struct import *import, bool at_end, const float wanted[2][3])
{
    double low[3] = {1e30, 1e30, 1e30}, high[3] = {-1e30, -1e30, -1e30};
    for (uint32_t i = 0; i < import->instance_count; i++)
        if (!import->instances[i].skipped)
            extend(import, &import->instances[i], at_end, low, high);
    for (int axis = 0; axis < 3; axis++) {
        assert_float_equal(low[axis], wanted[0][axis], 1e-5);
        assert_float_equal(high[axis], wanted[1][axis], 1e-5);
    }
}

/* Checks the bounds at both ends of the shutter interval. Those that are not given are the ones before. */
static void check_all_bounds(const struct gltf_case *gltf_case, const struct import *import)
{
    static const float none[3] = {0};
    const float(*const given[2])[3] = {&gltf_case->low, &gltf_case->end_low};
    float wanted[2][3] = {{0, 0, 0}, {2, 3, 0}};
    for (int end = 0; end < 2; end++) {
        const float *high = end ? gltf_case->end_high : gltf_case->high;
        if (memcmp(*given[end], none, sizeof none) || memcmp(high, none, sizeof none)) {
            memcpy(wanted[0], *given[end], sizeof wanted[0]);
            memcpy(wanted[1], high, sizeof wanted[1]);
        }
        check_bounds(import, end == 1, (const float(*)[3])wanted);
    }
}

static void check_counts(const struct gltf_case *gltf_case, const struct import_counts *counts)
{
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++) {
        bool is_it = gltf_case->kind && !strcmp(gltf_case->kind, import_count_kinds[i].name);
        assert_int_equal(import_counts_get(counts, i), is_it ? gltf_case->count : 0);
    }
}

/* Everything that belongs to a mesh, and not to the file as a whole, is counted for the mesh, too. */
static void check_mesh_counts(const struct import *import)
{
    static const char *const of_file[] = {"animations", "channels", "meshes", "nodes", "scenes", "extensions"};
    struct import_counts sum = {0};
    for (uint32_t i = 0; i < import->mesh_count; i++)
        import_counts_add_mesh(&sum, &import->meshes[i].counts);
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++) {
        bool is_of_file = false;
        for (size_t k = 0; k < sizeof of_file / sizeof *of_file; k++)
            is_of_file |= !strcmp(import_count_kinds[i].name, of_file[k]);
        assert_int_equal(import_counts_get(&sum, i), is_of_file ? 0 : import_counts_get(&import->counts, i));
    }
}

static void check_import(const struct gltf_case *gltf_case, const struct import *import)
{
    assert_int_equal(import->triangle_count, gltf_case->triangles ? gltf_case->triangles : 2);
    assert_int_equal(import->instance_count, gltf_case->instances ? gltf_case->instances : 1);
    assert_int_equal(import->skipped_instances, gltf_case->skipped);
    assert_int_equal(import->bottom_count, gltf_case->bottoms ? gltf_case->bottoms : 1);
    assert_int_equal(import->has_source, gltf_case->scene != NULL);
    assert_int_equal(import->is_shutter, gltf_case->until != NULL);
    assert_int_equal(import_turning_count(import), gltf_case->srts);
    assert_int_equal(import->motion_count - import_turning_count(import), gltf_case->matrices);
    assert_int_equal(import->moving_meshes, gltf_case->moving);
    assert_true(import->instance_deviation.distance <= gltf_case->off + 1e-5); /* another pivot may be a bit better */
    assert_true(import->instance_deviation.distance >= 0.97 * gltf_case->off - 1e-5);
    assert_float_equal(import->vertex_deviation.distance, gltf_case->vertices_off, 1e-5);
    check_all_bounds(gltf_case, import);
    check_counts(gltf_case, &import->counts);
    check_mesh_counts(import);
}

static struct import_moment moment_of(const struct gltf_case *gltf_case)
{
    return (struct import_moment){.time = gltf_case->at ? strtod(gltf_case->at, NULL) : 0,
                                  .animation = gltf_case->animation,
                                  .is_shutter = gltf_case->until != NULL,
                                  .end = gltf_case->until ? strtod(gltf_case->until, NULL) : 0};
}

static void check_case(const struct gltf_case *gltf_case)
{
    static uint8_t bytes[GLTF_CASE_ROOM];
    char text[512];
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    write_file("case.glb", bytes, gltf_case_make(gltf_case, bytes));
    memory_init(&memory, UINT64_MAX);
    print_message("%s\n", gltf_case->name);
    const struct import_moment moment = moment_of(gltf_case);
    const struct import_wish wish = {.scene = gltf_case->scene, .moment = gltf_case->at ? &moment : NULL};
    enum bvhd_status status = import_scene_as("case.glb", &wish, &memory, &import, &error);
    snprintf(text, sizeof text, "%s: %s", error.where, error.text);
    if (status != gltf_case->status)
        fail_msg("status %d, %s", status, text);
    if (!status) {
        check_import(gltf_case, &import);
        import_finish(&import);
    } else if (!strstr(text, gltf_case->text) || strncmp(text, "case.glb", 8)) {
        fail_msg("'%s' does not say '%s'", text, gltf_case->text);
    }
    assert_int_equal(memory.live, 0);
}

static void test_cases(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < gltf_case_count; i++)
        check_case(&gltf_cases[i]);
}

static const struct gltf_case *find_case(const char *name)
{
    for (uint32_t i = 0; i < gltf_case_count; i++)
        if (!strcmp(gltf_cases[i].name, name))
            return &gltf_cases[i];
    fail_msg("no case %s", name);
    return NULL;
}

/* Reads the file of a case in this process, so that a mistake of the reader is seen. */
static enum bvhd_status read_here(const char *path, const struct gltf_case *gltf_case, struct memory *memory)
{
    struct import import;
    struct bvhd_error error = {0};
    const struct import_moment moment = moment_of(gltf_case);
    const struct import_wish wish = {.scene = gltf_case->scene, .moment = gltf_case->at ? &moment : NULL};
    enum bvhd_status status = import_read_as(path, &wish, memory, &import, &error);
    if (!status)
        import_finish(&import);
    else
        assert_true(error.status == status && *error.where && *error.text);
    assert_int_equal(memory->live, 0);
    return status;
}

/* What a child process reads right is read right in this one, where tools see what it does. */
static void test_cases_here(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t i = 0; i < gltf_case_count; i++) {
        write_file("here.glb", bytes, gltf_case_make(&gltf_cases[i], bytes));
        assert_int_equal(read_here("here.glb", &gltf_cases[i], &memory), gltf_cases[i].status);
    }
}

/* A GLB that is cut off anywhere is refused, also if its header says the length that it has. */
static void test_truncated(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    size_t size = gltf_case_make(find_case("plain"), bytes);
    for (int patched = 0; patched < 2; patched++)
        for (size_t length = 0; length < size; length++) {
            uint32_t said = (uint32_t)(patched ? length : size);
            memcpy(bytes + 8, &said, sizeof said);
            write_file("cut.glb", bytes, length);
            enum bvhd_status status = read_here("cut.glb", find_case("plain"), &memory);
            assert_true(status == BVHD_UNSUPPORTED || status == BVHD_INVALID);
        }
}

/* Random bytes in random places: anything may come of it, but no crash and no lost memory. */
static void test_mutations(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    uint64_t random = 88172645463325252u;
    struct memory memory;
    memory_init(&memory, UINT64_C(1) << 28);
    for (int round = 0; round < 4000; round++) {
        size_t size = gltf_case_make(&gltf_cases[round % gltf_case_count], bytes);
        for (int i = 0; i < 1 + round % 5; i++) {
            random ^= random << 13, random ^= random >> 7, random ^= random << 17;
            bytes[(random >> 16) % size] = (uint8_t)(random & 1 ? random >> 40 : '0' + (random >> 40) % 10);
        }
        write_file("changed.glb", bytes, size);
        read_here("changed.glb", &gltf_cases[round % gltf_case_count], &memory);
    }
}

/* Each allocation fails once, in files that take all kinds of paths. */
static void test_no_memory(void **state)
{
    (void)state;
    static const char *const names[] = {"plain",
                                        "strip",
                                        "sparse",
                                        "meshopt vertices",
                                        "instancing with rotations",
                                        "no scenes",
                                        "scene by name",
                                        "cubic spline",
                                        "node with a name",
                                        "weights of a node",
                                        "animated weights of sparse targets",
                                        "animated joint",
                                        "shutter, turning",
                                        "shutter, joints",
                                        "shutter, weights of points",
                                        "shutter, two nodes with weights"};
    static uint8_t bytes[GLTF_CASE_ROOM];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const struct gltf_case *gltf_case = find_case(names[i]);
        write_file("memory.glb", bytes, gltf_case_make(gltf_case, bytes));
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t after = 0; status; after++) {
            struct memory memory;
            memory_init(&memory, UINT64_MAX);
            atomic_store(&memory.fail_after, after);
            status = read_here("memory.glb", gltf_case, &memory);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_true(after < 200);
        }
    }
}

/* A chain of nodes as deep as the file is long does not need a deep stack. */
static void test_deep_chain(void **state)
{
    (void)state;
    enum { NODES = 100000 };
    struct memory memory;
    struct import import;
    memory_init(&memory, UINT64_MAX);
    FILE *file = fopen("deep.gltf", "w");
    fputs("{\"asset\":{\"version\":\"2.0\"},\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
          "\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],\"nodes\":[",
          file);
    for (int i = 1; i < NODES; i++)
        fprintf(file, "{\"children\":[%d],\"translation\":[1,0,0]},", i);
    fputs("{\"mesh\":0}]}", file);
    fclose(file);
    assert_int_equal(import_scene("deep.gltf", NULL, &memory, &import, NULL), BVHD_OK);
    assert_int_equal(import.instance_count, 1);
    assert_true(import.instances[0].transform[3] == NODES - 1);
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cases),     cmocka_unit_test(test_cases_here), cmocka_unit_test(test_truncated),
        cmocka_unit_test(test_mutations), cmocka_unit_test(test_no_memory),  cmocka_unit_test(test_deep_chain),
    };
    return cmocka_run_group_tests_name("gltf", tests, scratch_enter, scratch_remove);
}
