/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/dance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/glb.h"

enum { JOINTS = 8, KEYS = 17 };
static const double pi = 3.14159265358979323846, seconds = 4, worm_height = 4;

/* A GLB while it is written. */
struct writer {
    struct glb glb;
    int times; /* the accessor of the times of all keys */
};

static void end(const char *why)
{
    fprintf(stderr, "dance: %s\n", why);
    exit(1);
}

static int put(struct writer *writer, const void *data, size_t size, enum glb_component component, uint64_t count,
               const char *type)
{
    return glb_put(&writer->glb, data, size, component, count, type);
}

static void put_channel(struct writer *writer, int node, const char *path, const char *interpolation, int values)
{
    glb_put_channel(&writer->glb, node, path, interpolation, writer->times, values);
}

static double key_time(int key)
{
    return seconds * key / (KEYS - 1);
}

/* ---- the parts ---- */

static void add_ball(struct mesh *mesh, double radius, uint32_t level)
{
    static const double centre[3] = {0, 0, 0};
    mesh_add_sphere(mesh, centre, radius, level, NULL, NULL);
}

/* Puts how far a sphere grows: in spikes, or by being pressed flat. */
static int put_target(struct writer *writer, const struct mesh *mesh, int is_flat)
{
    float(*moves)[3] = calloc(mesh->vertex_count, sizeof *moves);
    if (!moves)
        end("no memory");
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const float *at = mesh->vertices[i];
        double wave = sin(7 * atan2(at[2], at[0])) * sin(6 * acos(fmin(fmax(at[1], -1.0), 1.0)));
        for (int k = 0; k < 3; k++)
            moves[i][k] = is_flat ? (k == 1 ? -0.6f * at[1] : 0.4f * at[k]) : (float)(0.5 * wave * at[k]);
    }
    int accessor = put(writer, moves, mesh->vertex_count * sizeof *moves, GLB_FLOAT, mesh->vertex_count, "VEC3");
    free(moves);
    return accessor;
}

/* A ring of the worm belongs to the joint below it and the one above, by its height. */
static void put_bones(struct writer *writer, const struct mesh *mesh, int *ret_joints, int *ret_weights)
{
    uint8_t(*joints)[4] = calloc(mesh->vertex_count, sizeof *joints);
    float(*weights)[4] = calloc(mesh->vertex_count, sizeof *weights);
    if (!joints || !weights)
        end("no memory");
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        double place = fmin(fmax(mesh->vertices[i][1] / worm_height * JOINTS, 0), JOINTS - 1.001);
        joints[i][0] = (uint8_t)place;
        joints[i][1] = (uint8_t)(joints[i][0] + 1);
        weights[i][1] = (float)(place - joints[i][0]);
        weights[i][0] = 1 - weights[i][1];
    }
    *ret_joints = put(writer, joints, mesh->vertex_count * sizeof *joints, GLB_UINT8, mesh->vertex_count, "VEC4");
    *ret_weights = put(writer, weights, mesh->vertex_count * sizeof *weights, GLB_FLOAT, mesh->vertex_count, "VEC4");
    free(joints);
    free(weights);
}

static int put_binds(struct writer *writer)
{
    float binds[JOINTS][16] = {{0}};
    for (int i = 0; i < JOINTS; i++) {
        for (int k = 0; k < 16; k += 5)
            binds[i][k] = 1;
        binds[i][13] = (float)(-worm_height * i / JOINTS);
    }
    return put(writer, binds, sizeof binds, GLB_FLOAT, JOINTS, "MAT4");
}

/* ---- the motion ---- */

/* Rotates about an axis by an angle for each key. */
static void put_rotation(struct writer *writer, int node, const double axis[3], double (*angle)(int key, double phase),
                         double phase)
{
    float values[KEYS][4];
    for (int i = 0; i < KEYS; i++) {
        double half = angle(i, phase) / 2;
        for (int k = 0; k < 3; k++)
            values[i][k] = (float)(axis[k] * sin(half));
        values[i][3] = (float)cos(half);
    }
    put_channel(writer, node, "rotation", "LINEAR", put(writer, values, sizeof values, GLB_FLOAT, KEYS, "VEC4"));
}

static double sway(int key, double phase)
{
    return 0.3 * sin(2 * pi * key / (KEYS - 1) + phase);
}

static double circle(int key, double phase)
{
    return 2 * pi * key / (KEYS - 1) + phase;
}

/* Bounces by a spline whose tangents jump at the ground. */
static void put_bounce(struct writer *writer, int node, double x)
{
    float values[KEYS][3][3] = {{{0}}};
    for (int i = 0; i < KEYS; i++) {
        values[i][1][0] = (float)x;
        values[i][1][1] = i % 4 == 2 ? 1.6f : i % 4 == 0 ? 0.0f : 1.2f;
        values[i][0][1] = i % 4 == 0 ? -6.4f : i % 4 == 1 ? 3.2f : i % 4 == 2 ? 0.0f : -3.2f;
        values[i][2][1] = i % 4 == 0 ? 6.4f : values[i][0][1];
    }
    put_channel(writer, node, "translation", "CUBICSPLINE",
                put(writer, values, sizeof values, GLB_FLOAT, UINT64_C(3) * KEYS, "VEC3"));
}

static void put_weights(struct writer *writer, int node)
{
    float values[KEYS][2];
    for (int i = 0; i < KEYS; i++) {
        values[i][0] = (float)(0.5 - 0.5 * cos(2 * pi * i / (KEYS - 1)));
        values[i][1] = (float)fmax(0, sin(4 * pi * i / (KEYS - 1)));
    }
    put_channel(writer, node, "weights", "LINEAR",
                put(writer, values, sizeof values, GLB_FLOAT, UINT64_C(2) * KEYS, "SCALAR"));
}

/* Changes its size in steps. */
static void put_scale(struct writer *writer, int node)
{
    float values[KEYS][3];
    for (int i = 0; i < KEYS; i++)
        for (int k = 0; k < 3; k++)
            values[i][k] = i % 3 == 0 ? 1.0f : i % 3 == 1 ? 1.3f : 0.8f;
    put_channel(writer, node, "scale", "STEP", put(writer, values, sizeof values, GLB_FLOAT, KEYS, "VEC3"));
}

/* ---- the scene ---- */

/* Nodes 0 ground, 1 worm, 2 spiky ball, 3 arm, 4 to 6 balls on it, 7 and following joints. */
enum { WORM = 1, SPIKY, ARM, BALLS, FIRST_JOINT = 7 };

static void put_nodes(FILE *json)
{
    fputs("\"scenes\":[{\"nodes\":[0,1,2,3,7]}],\"nodes\":[{\"name\":\"ground\",\"mesh\":0},"
          "{\"name\":\"worm\",\"mesh\":1,\"skin\":0},{\"name\":\"spiky\",\"mesh\":2,\"translation\":[3,1.4,0]},"
          "{\"name\":\"arm\",\"children\":[4,5,6],\"translation\":[-3,0.5,0]}",
          json);
    for (int i = 0; i < 3; i++)
        fprintf(json, ",{\"name\":\"ball %d\",\"mesh\":3,\"translation\":[%g,0,%g]}", i, 1.5 * cos(2 * pi * i / 3),
                1.5 * sin(2 * pi * i / 3));
    for (int i = 0; i < JOINTS; i++) {
        fprintf(json, ",{\"name\":\"joint %d\",\"translation\":[0,%g,0]", i, i ? worm_height / JOINTS : 0);
        fprintf(json, i + 1 < JOINTS ? ",\"children\":[%d]}" : "}", FIRST_JOINT + i + 1);
    }
    fputs("],", json);
}

static void put_materials(FILE *json)
{
    static const float colours[4][3] = {
        {0.55f, 0.6f, 0.5f}, {0.75f, 0.25f, 0.2f}, {0.2f, 0.35f, 0.7f}, {0.85f, 0.65f, 0.2f}};
    fputs("\"materials\":[", json);
    for (int i = 0; i < 4; i++)
        fprintf(json, "%s{\"name\":\"material %d\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[%g,%g,%g,1]}}",
                i ? "," : "", i, (double)colours[i][0], (double)colours[i][1], (double)colours[i][2]);
    fputs("],", json);
}

static void make_meshes(struct mesh meshes[4], uint32_t size)
{
    static const double profile[2][2] = {{7, 0}, {0.001, 0}};
    uint32_t level = 1, sides = 24, rings = size / 2 / (2 * sides) + JOINTS;
    double(*worm)[2] = calloc(rings + 1, sizeof *worm);
    if (!worm)
        end("no memory");
    while (level < 7 && 20u << 2 * (level + 1) < size / 2)
        level++;
    for (uint32_t i = 0; i <= rings; i++) {
        double at = (double)i / rings;
        worm[i][0] = 0.02 + 0.4 * sqrt(fmax(0, 1 - at * at * at)) * (1 + 0.12 * sin(40 * at));
        worm[i][1] = at * worm_height;
    }
    mesh_add_lathe(&meshes[0], profile, 2, 48);
    mesh_add_lathe(&meshes[1], (const double(*)[2])worm, rings + 1, sides);
    add_ball(&meshes[2], 1, level);
    add_ball(&meshes[3], 0.45, 2);
    free(worm);
}

static void put_meshes(struct writer *writer, FILE *json, uint32_t size)
{
    struct mesh meshes[4] = {{0}};
    int joints, weights;
    make_meshes(meshes, size);
    fputs("\"meshes\":[", json);
    for (int i = 0; i < 4; i++) {
        static const char *const names[4] = {"ground", "worm", "spiky", "ball"};
        fprintf(json, "%s{\"name\":\"%s\",\"primitives\":[{\"material\":%d,\"attributes\":{\"POSITION\":%d",
                i ? "," : "", names[i], i, glb_put_positions(&writer->glb, &meshes[i]));
        if (i == WORM) {
            put_bones(writer, &meshes[i], &joints, &weights);
            fprintf(json, ",\"JOINTS_0\":%d,\"WEIGHTS_0\":%d", joints, weights);
        }
        fprintf(json, "},\"indices\":%d", glb_put_indices(&writer->glb, &meshes[i]));
        if (i == SPIKY) {
            int spikes = put_target(writer, &meshes[i], 0), flat = put_target(writer, &meshes[i], 1);
            fprintf(json, ",\"targets\":[{\"POSITION\":%d},{\"POSITION\":%d}]", spikes, flat);
        }
        fputs("}]}", json);
        mesh_finish(&meshes[i]);
    }
    fprintf(json, "],\"skins\":[{\"inverseBindMatrices\":%d,\"joints\":[", put_binds(writer));
    for (int i = 0; i < JOINTS; i++)
        fprintf(json, "%s%d", i ? "," : "", FIRST_JOINT + i);
    fputs("]}],", json);
}

static void put_motion(struct writer *writer)
{
    static const double up[3] = {0, 1, 0}, sideways[3] = {0.6, 0, 0.8};
    float times[KEYS];
    for (int i = 0; i < KEYS; i++)
        times[i] = (float)key_time(i);
    writer->times = put(writer, times, sizeof times, GLB_FLOAT, KEYS, "SCALAR");
    for (int i = 0; i < JOINTS; i++)
        put_rotation(writer, FIRST_JOINT + i, sideways, sway, 0.8 * i);
    put_weights(writer, SPIKY);
    put_rotation(writer, ARM, up, circle, 0);
    put_bounce(writer, BALLS, 1.5);
    put_scale(writer, BALLS + 1);
}

int dance_write(const char *path, uint32_t size)
{
    struct writer writer;
    glb_init(&writer.glb);
    put_nodes(writer.glb.json);
    put_materials(writer.glb.json);
    put_meshes(&writer, writer.glb.json, size);
    put_motion(&writer);
    return glb_write(&writer.glb, "dance", path);
}
