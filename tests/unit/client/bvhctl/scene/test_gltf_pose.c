/* SPDX-License-Identifier: Apache-2.0 */
/* test_gltf_pose.c - tests skins, morph targets and animations of random scenes against an independent evaluation. */
#include "tests/support/unit.h"

#include <math.h>
#include <unistd.h>

#include "client/bvhctl/scene/gltf_sampler.h"
#include "client/bvhctl/scene/import.h"
#include "tests/support/random.h"
#include "tests/support/scene/gltf_case.h"

enum { JOINTS = 4, VERTICES = 12, TARGETS = 2, KEYS = 4, SETS = 2 };

/* One property over time, with tangents as glTF stores them. */
struct track {
    int interpolation; /* of enum gltf_interpolation */
    int width;
    float times[KEYS], values[3 * KEYS][4];
};

/* A mesh with two morph targets on a chain of joints, of which everything moves. */
struct puppet {
    struct track moves[JOINTS], turns[JOINTS], scales[JOINTS], weights;
    float positions[VERTICES][3], targets[TARGETS][VERTICES][3];
    uint8_t joints[SETS][VERTICES][4];
    float shares[SETS][VERTICES][4];
    float binds[JOINTS][16]; /* columns */
};

static void make_track(struct random *random, int width, struct track *track)
{
    bool is_rotation = width == 4;
    *track = (struct track){.interpolation = (int)(random_next(random) % 3), .width = width};
    for (int key = 0; key < KEYS; key++)
        track->times[key] = (float)(key ? track->times[key - 1] + 0.2 + fabs(random_between(random, -1, 1))
                                        : fabs(random_between(random, -1, 1)));
    for (int i = 0; i < 3 * KEYS; i++) {
        double length = 0;
        for (int k = 0; k < width; k++) {
            track->values[i][k] = (float)(random_between(random, -1, 1) + (width == 3 && !is_rotation ? 1.5 : 0));
            length += (double)track->values[i][k] * track->values[i][k];
        }
        bool is_value = track->interpolation != GLTF_CUBICSPLINE || i % 3 == 1;
        for (int k = 0; k < width && is_rotation && is_value; k++)
            track->values[i][k] = (float)(track->values[i][k] / sqrt(length));
    }
}

static void make_puppet(struct random *random, struct puppet *puppet)
{
    for (int i = 0; i < JOINTS; i++) {
        make_track(random, 3, &puppet->moves[i]);
        make_track(random, 4, &puppet->turns[i]);
        make_track(random, 3, &puppet->scales[i]);
        for (int k = 0; k < 16; k++)
            puppet->binds[i][k] = k % 4 == 3 ? (float)(k == 15) : (float)random_between(random, -1, 1);
    }
    make_track(random, TARGETS, &puppet->weights);
    for (int i = 0; i < VERTICES; i++)
        for (int k = 0; k < 4; k++) {
            for (int t = 0; t < TARGETS && k < 3; t++)
                puppet->targets[t][i][k] = (float)random_between(random, -1, 1);
            if (k < 3)
                puppet->positions[i][k] = (float)random_between(random, -1, 1);
            for (int set = 0; set < SETS; set++) {
                puppet->joints[set][i][k] = (uint8_t)(random_next(random) % JOINTS);
                puppet->shares[set][i][k] = (float)fabs(random_between(random, -1, 1));
            }
        }
}

/* ---- the file ---- */

struct writer {
    uint8_t bin[8192];
    size_t size;
    int count; /* of accessors, and of the views that they have */
    char views[4096], accessors[8192], channels[4096], samplers[4096];
    int sampler_count;
};

static void append(char *text, size_t room, const char *format, ...)
{
    va_list arguments;
    size_t used = strlen(text);
    va_start(arguments, format);
    vsnprintf(text + used, room - used, format, arguments);
    va_end(arguments);
    assert_true(strlen(text) + 1 < room);
}

static int put(struct writer *writer, const void *data, size_t size, int component, int count, const char *type)
{
    assert_true(writer->size + size <= sizeof writer->bin);
    memcpy(writer->bin + writer->size, data, size);
    append(writer->views, sizeof writer->views, "%s{'buffer':0,'byteOffset':%zu,'byteLength':%zu}",
           writer->count ? "," : "", writer->size, size);
    append(writer->accessors, sizeof writer->accessors, "%s{'bufferView':%d,'componentType':%d,'count':%d,'type':'%s'}",
           writer->count ? "," : "", writer->count, component, count, type);
    writer->size += size;
    return writer->count++;
}

static void put_track(struct writer *writer, const struct track *track, int node, const char *path)
{
    static const char *const names[] = {"LINEAR", "STEP", "CUBICSPLINE"}, *const types[] = {"SCALAR", "VEC3", "VEC4"};
    float values[3 * KEYS * 4];
    int rows = KEYS * (track->interpolation == GLTF_CUBICSPLINE ? 3 : 1);
    for (int i = 0; i < rows; i++)
        memcpy(values + i * track->width, track->values[i], (size_t)track->width * sizeof(float));
    bool are_weights = track->width == TARGETS;
    int input = put(writer, track->times, sizeof track->times, 5126, KEYS, "SCALAR");
    int output = put(writer, values, (size_t)(rows * track->width) * sizeof(float), 5126,
                     are_weights ? rows * track->width : rows, types[are_weights ? 0 : track->width - 2]);
    append(writer->channels, sizeof writer->channels, "%s{'sampler':%d,'target':{'node':%d,'path':'%s'}}",
           writer->sampler_count ? "," : "", writer->sampler_count, node, path);
    append(writer->samplers, sizeof writer->samplers, "%s{'input':%d,'output':%d,'interpolation':'%s'}",
           writer->sampler_count ? "," : "", input, output, names[track->interpolation]);
    writer->sampler_count++;
}

/* Node 0 has the mesh, nodes 1 and following are the chain of joints. */
static size_t write_puppet(const struct puppet *puppet, uint8_t ret_bytes[GLTF_CASE_ROOM])
{
    static struct writer writer;
    static char json[GLTF_CASE_ROOM];
    uint16_t indices[VERTICES];
    writer = (struct writer){0};
    for (int i = 0; i < VERTICES; i++)
        indices[i] = (uint16_t)i;
    put(&writer, puppet->positions, sizeof puppet->positions, 5126, VERTICES, "VEC3");
    put(&writer, indices, sizeof indices, 5123, VERTICES, "SCALAR");
    for (int i = 0; i < TARGETS; i++)
        put(&writer, puppet->targets[i], sizeof puppet->targets[i], 5126, VERTICES, "VEC3");
    for (int i = 0; i < SETS; i++) {
        put(&writer, puppet->joints[i], sizeof puppet->joints[i], 5121, VERTICES, "VEC4");
        put(&writer, puppet->shares[i], sizeof puppet->shares[i], 5126, VERTICES, "VEC4");
    }
    int binds = put(&writer, puppet->binds, sizeof puppet->binds, 5126, JOINTS, "MAT4");
    for (int i = 0; i < JOINTS; i++) {
        put_track(&writer, &puppet->moves[i], i + 1, "translation");
        put_track(&writer, &puppet->turns[i], i + 1, "rotation");
        put_track(&writer, &puppet->scales[i], i + 1, "scale");
    }
    put_track(&writer, &puppet->weights, 0, "weights");
    int length =
        snprintf(json, sizeof json,
                 "{'asset':{'version':'2.0'},'scenes':[{'nodes':[0,1]}],'nodes':[{'mesh':0,'skin':0,'scale':[9,9,9]},"
                 "{'children':[2]},{'children':[3]},{'children':[4]},{}],'skins':[{'joints':[1,2,3,4],"
                 "'inverseBindMatrices':%d}],'meshes':[{'primitives':[{'attributes':{'POSITION':0,'JOINTS_0':4,"
                 "'WEIGHTS_0':5,'JOINTS_1':6,'WEIGHTS_1':7},'indices':1,'targets':[{'POSITION':2},{'POSITION':3}]}]}],"
                 "'animations':[{'channels':[%s],'samplers':[%s]}],'buffers':[{'byteLength':%zu}],'bufferViews':[%s],"
                 "'accessors':[%s]}",
                 binds, writer.channels, writer.samplers, writer.size, writer.views, writer.accessors);
    assert_true(length < (int)sizeof json);
    return gltf_case_pack(json, writer.bin, writer.size, ret_bytes);
}

/* ---- the independent evaluation: no matrices, points and quaternions only ---- */

static void multiply(const double a[4], const double b[4], double ret[4])
{
    double x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
    double y = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2];
    double z = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0];
    double w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
    ret[0] = x, ret[1] = y, ret[2] = z, ret[3] = w;
}

/* Turns from `a` to `b` about the axis between them, by a share of the angle. */
static void turn_between(const double a[4], const double b[4], double share, double ret[4])
{
    double back[4] = {-a[0], -a[1], -a[2], a[3]}, between[4];
    multiply(b, back, between);
    double sign = between[3] < 0 ? -1 : 1;
    double sine = sqrt(between[0] * between[0] + between[1] * between[1] + between[2] * between[2]);
    double angle = atan2(sine, fabs(between[3])) * share, scale = sine > 0 ? sign * sin(angle) / sine : 0;
    double part[4] = {between[0] * scale, between[1] * scale, between[2] * scale, cos(angle)};
    multiply(part, a, ret);
}

static void evaluate(const struct track *track, double time, double ret[4])
{
    int step = track->interpolation == GLTF_CUBICSPLINE ? 3 : 1, at = step == 3 ? 1 : 0, key = 0;
    while (key + 1 < KEYS && track->times[key + 1] <= time)
        key++;
    bool is_still = time <= track->times[0] || key + 1 == KEYS || track->interpolation == GLTF_STEP;
    double seconds = is_still ? 1 : (double)track->times[key + 1] - track->times[key];
    double s = is_still ? 0 : (time - track->times[key]) / seconds, a[4] = {0}, b[4] = {0};
    const float *from = track->values[step * key + at], *to = track->values[is_still ? 0 : step * (key + 1) + at];
    for (int k = 0; k < track->width; k++) {
        a[k] = from[k], b[k] = to[k];
        ret[k] = a[k] + s * (b[k] - a[k]);
        if (is_still)
            ret[k] = a[k];
        else if (step == 3) { /* de Casteljau's algorithm on the control points of the spline */
            double p = a[k] + seconds / 3 * track->values[3 * key + 2][k];
            double q = b[k] - seconds / 3 * track->values[3 * key + 3][k];
            double l = a[k] + s * (p - a[k]), m = p + s * (q - p), n = q + s * (b[k] - q);
            double lm = l + s * (m - l), mn = m + s * (n - m);
            ret[k] = lm + s * (mn - lm);
        }
    }
    if (track->width == 4 && !is_still && step == 1)
        turn_between(a, b, s, ret);
    double length = track->width == 4 ? sqrt(ret[0] * ret[0] + ret[1] * ret[1] + ret[2] * ret[2] + ret[3] * ret[3]) : 1;
    for (int k = 0; k < track->width; k++)
        ret[k] /= length;
}

/* Moves a point from the space of a joint to the world, joint by joint. */
static void carry(const struct puppet *puppet, int joint, double time, double point[3])
{
    for (; joint >= 0; joint--) {
        double move[4], turn[4], scale[4], back[4], vector[4];
        evaluate(&puppet->moves[joint], time, move);
        evaluate(&puppet->turns[joint], time, turn);
        evaluate(&puppet->scales[joint], time, scale);
        for (int k = 0; k < 3; k++) {
            vector[k] = point[k] * scale[k];
            back[k] = -turn[k];
        }
        vector[3] = 0, back[3] = turn[3];
        multiply(turn, vector, vector);
        multiply(vector, back, vector);
        for (int k = 0; k < 3; k++)
            point[k] = vector[k] + move[k];
    }
}

static void expect_vertex(const struct puppet *puppet, int vertex, double time, double ret[3])
{
    double weights[4], sum = 0, start[3];
    evaluate(&puppet->weights, time, weights);
    for (int k = 0; k < 3; k++) {
        start[k] = puppet->positions[vertex][k];
        for (int t = 0; t < TARGETS; t++)
            start[k] += weights[t] * puppet->targets[t][vertex][k];
        ret[k] = 0;
    }
    for (int i = 0; i < 4 * SETS; i++) {
        int joint = puppet->joints[i / 4][vertex][i % 4];
        double share = puppet->shares[i / 4][vertex][i % 4], point[3];
        for (int k = 0; k < 3; k++) {
            const float *columns = puppet->binds[joint];
            point[k] = columns[k] * start[0] + columns[4 + k] * start[1] + columns[8 + k] * start[2] + columns[12 + k];
        }
        carry(puppet, joint, time, point);
        for (int k = 0; k < 3; k++)
            ret[k] += share * point[k];
        sum += share;
    }
    for (int k = 0; k < 3; k++)
        ret[k] /= sum;
}

/* ---- tests ---- */

static void check_moment(const struct puppet *puppet, double time, const char *path)
{
    struct memory memory;
    struct import import;
    struct bvhd_error error = {0};
    const struct import_moment moment = {.time = time};
    const struct import_wish wish = {.moment = &moment};
    memory_init(&memory, UINT64_MAX);
    if (import_read_as(path, &wish, &memory, &import, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_true(import.has_moment && import.time == time && import.has_animation && import.animation == 0);
    assert_true(import.bottom_count == 1 && import.instance_count == 1 && import.mesh_count == 1);
    assert_false(import_counts_any(&import.counts));
    for (int k = 0; k < 12; k++) /* joints have placed it in the world */
        assert_true(import.instances[0].transform[k] == (k % 5 == 0 ? 1.0f : 0.0f));
    assert_int_equal(import.meshes[0].vertex_count, VERTICES);
    for (int i = 0; i < VERTICES; i++) {
        double expected[3];
        expect_vertex(puppet, i, time, expected);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(import.meshes[0].positions[3 * i + k] - expected[k]) <= 1e-6 * (1 + fabs(expected[k])));
    }
    import_finish(&import);
    assert_int_equal(memory.live, 0);
}

static void test_puppets(void **state)
{
    (void)state;
    static uint8_t bytes[GLTF_CASE_ROOM];
    char path[] = "/tmp/bvhd-test-pose-XXXXXX";
    int descriptor = mkstemp(path);
    struct random random = {2026};
    assert_true(descriptor >= 0);
    for (int round = 0; round < 60; round++) {
        struct puppet puppet;
        make_puppet(&random, &puppet);
        size_t size = write_puppet(&puppet, bytes);
        assert_true(ftruncate(descriptor, 0) == 0 && pwrite(descriptor, bytes, size, 0) == (ssize_t)size);
        for (int i = 0; i < 8; i++)
            check_moment(&puppet, i == 0 ? puppet.moves[0].times[1] : 2.5 + random_between(&random, -3, 3), path);
    }
    close(descriptor);
    unlink(path);
}

/* Rotations go the shorter way round, also between quaternions of opposite signs, and nearly equal ones stay finite. */
static void test_shorter_way(void **state)
{
    (void)state;
    static const float times[2] = {0, 1};
    const float sine = (float)sin(0.2), cosine = (float)cos(0.2);
    float values[2][4] = {{0, 0, 0, 1}, {0, 0, -sine, -cosine}};
    struct gltf_sampler sampler = {GLTF_LINEAR, true, 2, 4, times, values[0]};
    double rotation[4];
    gltf_sampler_at(&sampler, 0.5, rotation);
    assert_float_equal(rotation[2], sin(0.1), 1e-6);
    assert_float_equal(rotation[3], cos(0.1), 1e-6);
    values[1][2] = 1e-9f, values[1][3] = 1;
    gltf_sampler_at(&sampler, 0.5, rotation);
    assert_float_equal(rotation[2], 5e-10, 1e-15);
    assert_float_equal(rotation[3], 1, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_puppets), cmocka_unit_test(test_shorter_way)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
