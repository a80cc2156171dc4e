/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/fair.h"

#include <math.h>
#include <stdlib.h>

#include "tests/support/scene/glb.h"
#include "tests/support/scene/shapes.h"

enum { KEYS = 33, SEATS = 6, BALLS = 3, LEAST_BOUNCES = 2 };
static const double pi = 3.14159265358979323846, seconds = 4;
static const struct at fan = {-3.4, 3.2, 0}, carousel = {0, 0, -0.5}, flag = {2.6, 3.9, 0};

/* The meshes, and the nodes that show them. Seats and balls follow the nodes with numbers of their own. */
enum mesh_name { GROUND, POLES, ROTOR, FLAG, PLATFORM, SEAT, BALL, MESHES };
enum { FIRST_SEAT = PLATFORM + 1, FIRST_BALL = FIRST_SEAT + SEATS };

/* ---- the meshes ---- */

static void make_ground(struct mesh *mesh)
{
    static const double profile[2][2] = {{7, 0}, {0.001, 0}};
    mesh_add_lathe(mesh, profile, 2, 64);
}

static void make_poles(struct mesh *mesh)
{
    shapes_rod(mesh, (struct at){fan.x, 0, -0.15}, (struct at){fan.x, fan.y, -0.15}, 0.09);
    shapes_ball(mesh, (struct at){fan.x, fan.y, -0.1}, 0.2);
    shapes_rod(mesh, (struct at){flag.x, 0, 0}, (struct at){flag.x, flag.y + 0.2, 0}, 0.05);
    shapes_ball(mesh, (struct at){flag.x, flag.y + 0.25, 0}, 0.1);
    shapes_rod(mesh, (struct at){carousel.x, 0, carousel.z}, (struct at){carousel.x, 2.4, carousel.z}, 0.08);
}

/* Five blades around a hub, which is in the origin. */
static void make_rotor(struct mesh *mesh)
{
    static const double blade[5][2] = {{-0.08, 0}, {0.08, 0}, {0.34, 1.2}, {0.16, 1.5}, {-0.06, 1.4}};
    shapes_ball(mesh, (struct at){0, 0, 0.1}, 0.22);
    for (int i = 0; i < 5; i++) {
        uint32_t first = mesh->vertex_count;
        shapes_plate(mesh, (struct at){0, 0.1, 0.1}, blade, 5, 0.03);
        shapes_turn(mesh, first, (struct at){0, 0.1, 0.1}, 1, 0.35);
        shapes_turn(mesh, first, (struct at){0, 0, 0}, 2, 2 * pi * i / 5);
    }
}

/* A cloth from its upper corner at the pole, 3 wide and 1.8 high. */
static void make_flag(struct mesh *mesh, uint32_t size)
{
    uint32_t rows = (uint32_t)sqrt(size / 2.0 * 0.6) + 2, columns = (uint32_t)(rows / 0.6) + 2;
    for (uint32_t i = 0; i < rows * columns; i++)
        mesh_add_vertex(mesh, 3.0 * (i % columns) / (columns - 1), -1.8 * (i / columns) / (rows - 1), 0);
    for (uint32_t i = 0; i + 1 < rows; i++)
        for (uint32_t k = 0; k + 1 < columns; k++) {
            uint32_t at = i * columns + k;
            mesh_add_quad(mesh, at, at + columns, at + columns + 1, at + 1);
        }
}

/* How far the cloth is bent: a wave that grows with the distance from the pole. Two of them make one that runs. */
static int put_wave(struct glb *glb, const struct mesh *mesh, double phase)
{
    float(*moves)[3] = calloc(mesh->vertex_count, sizeof *moves);
    if (!moves) {
        fputs("fair: no memory\n", stderr);
        exit(1);
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const double x = mesh->vertices[i][0], y = mesh->vertices[i][1];
        moves[i][2] = (float)(0.16 * x * cos(2.4 * x + 0.5 * y - phase));
        moves[i][1] = (float)(-0.02 * x * x * cos(2.4 * x - phase));
    }
    int accessor = glb_put(glb, moves, mesh->vertex_count * sizeof *moves, GLB_FLOAT, mesh->vertex_count, "VEC3");
    free(moves);
    return accessor;
}

static void make_platform(struct mesh *mesh)
{
    static const double roof[2][2] = {{2.1, 0}, {0.001, 0.5}};
    shapes_cylinder(mesh, (struct at){0, 0.12, 0}, 2, 2, 0.1);
    shapes_lathe(mesh, (struct at){0, 1.9, 0}, roof, 2, 24);
    for (int i = 0; i < SEATS; i++) {
        const double x = 1.5 * cos(2 * pi * i / SEATS), z = 1.5 * sin(2 * pi * i / SEATS);
        shapes_rod(mesh, (struct at){x, 0.2, z}, (struct at){x, 2, z}, 0.025);
    }
}

static void make_seat(struct mesh *mesh)
{
    shapes_box(mesh, (struct at){0, 0, 0}, (struct at){0.5, 0.1, 0.4});
    shapes_box(mesh, (struct at){-0.22, 0.25, 0}, (struct at){0.06, 0.5, 0.4});
}

static void make_meshes(struct mesh meshes[MESHES], uint32_t size)
{
    make_ground(&meshes[GROUND]);
    make_poles(&meshes[POLES]);
    make_rotor(&meshes[ROTOR]);
    make_flag(&meshes[FLAG], size);
    make_platform(&meshes[PLATFORM]);
    make_seat(&meshes[SEAT]);
    shapes_ball(&meshes[BALL], (struct at){0, 0, 0}, 0.3);
}

static void put_meshes(struct glb *glb, uint32_t size)
{
    static const char *const names[MESHES] = {"ground", "poles", "rotor", "flag", "platform", "seat", "ball"};
    struct mesh meshes[MESHES] = {{0}};
    make_meshes(meshes, size);
    fputs("\"meshes\":[", glb->json);
    for (int i = 0; i < MESHES; i++) {
        int positions = glb_put_positions(glb, &meshes[i]), indices = glb_put_indices(glb, &meshes[i]);
        fprintf(glb->json,
                "%s{\"name\":\"%s\",\"primitives\":[{\"material\":%d,\"attributes\":{\"POSITION\":%d},\"indices\":%d",
                i ? "," : "", names[i], i, positions, indices);
        if (i == FLAG) {
            int wave = put_wave(glb, &meshes[i], 0), later = put_wave(glb, &meshes[i], pi / 2);
            fprintf(glb->json, ",\"targets\":[{\"POSITION\":%d},{\"POSITION\":%d}]", wave, later);
        }
        fputs("}]}", glb->json);
        mesh_finish(&meshes[i]);
    }
    fputs("],", glb->json);
}

/* ---- the nodes ---- */

static void put_node(FILE *json, const char *name, enum mesh_name mesh, struct at at)
{
    fprintf(json, "%s{\"name\":\"%s\",\"mesh\":%d,\"translation\":[%g,%g,%g]", mesh == GROUND ? "" : "},", name, mesh,
            at.x, at.y, at.z);
}

static void put_nodes(FILE *json)
{
    char name[32];
    fputs("\"scenes\":[{\"nodes\":[0,1,2,3,4", json);
    for (int i = 0; i < BALLS; i++)
        fprintf(json, ",%d", FIRST_BALL + i);
    fputs("]}],\"nodes\":[", json);
    put_node(json, "ground", GROUND, (struct at){0, 0, 0});
    put_node(json, "poles", POLES, (struct at){0, 0, 0});
    put_node(json, "rotor", ROTOR, fan);
    put_node(json, "flag", FLAG, flag);
    put_node(json, "carousel", PLATFORM, carousel);
    fputs(",\"children\":[", json);
    for (int i = 0; i < SEATS; i++)
        fprintf(json, i ? ",%d" : "%d", FIRST_SEAT + i);
    fputs("]", json);
    for (int i = 0; i < SEATS; i++) {
        snprintf(name, sizeof name, "seat %d", i);
        put_node(json, name, SEAT, (struct at){1.5 * cos(2 * pi * i / SEATS), 0.6, 1.5 * sin(2 * pi * i / SEATS)});
    }
    for (int i = 0; i < BALLS; i++) {
        snprintf(name, sizeof name, "ball %d", i);
        put_node(json, name, BALL, (struct at){0, 0, 0});
    }
    fputs("}],", json);
}

static void put_materials(FILE *json)
{
    static const float colours[MESHES][3] = {{0.45f, 0.55f, 0.35f}, {0.5f, 0.5f, 0.52f},  {0.85f, 0.3f, 0.12f},
                                             {0.75f, 0.08f, 0.1f},  {0.85f, 0.7f, 0.35f}, {0.15f, 0.3f, 0.65f},
                                             {0.9f, 0.75f, 0.15f}};
    fputs("\"materials\":[", json);
    for (int i = 0; i < MESHES; i++)
        fprintf(json,
                "%s{\"name\":\"material "
                "%d\",\"doubleSided\":true,\"pbrMetallicRoughness\":{\"baseColorFactor\":[%g,%g,%g,1]}}",
                i ? "," : "", i, (double)colours[i][0], (double)colours[i][1], (double)colours[i][2]);
    fputs("],", json);
}

/* ---- the motion ---- */

/* Turns about axis 0 x, 1 y or 2 z, evenly; `turns` a second, so that keys are less than half a turn apart. */
static void put_turn(struct glb *glb, int node, int axis, double turns, double phase, int times)
{
    float values[KEYS][4] = {{0}};
    for (int i = 0; i < KEYS; i++) {
        const double half = pi * turns * seconds * i / (KEYS - 1) + phase / 2;
        values[i][axis] = (float)sin(half);
        values[i][3] = (float)cos(half);
    }
    glb_put_channel(glb, node, "rotation", "LINEAR", times,
                    glb_put(glb, values, sizeof values, GLB_FLOAT, KEYS, "VEC4"));
}

/* A wave that runs through the flag once a second. */
static void put_weights(struct glb *glb, int times)
{
    float values[KEYS][2];
    for (int i = 0; i < KEYS; i++) {
        values[i][0] = (float)cos(2 * pi * seconds * i / (KEYS - 1));
        values[i][1] = (float)sin(2 * pi * seconds * i / (KEYS - 1));
    }
    glb_put_channel(glb, FLAG, "weights", "LINEAR", times,
                    glb_put(glb, values, sizeof values, GLB_FLOAT, UINT64_C(2) * KEYS, "SCALAR"));
}

/* Falls and bounces by parabolas, of which each half is a cubic spline. A ball rolls on while it does so. */
static void put_bounce(struct glb *glb, int ball)
{
    enum { MOST_ROWS = 2 * (LEAST_BOUNCES + BALLS) + 1 };
    const int rows = 2 * (LEAST_BOUNCES + ball) + 1;
    float times[MOST_ROWS], values[MOST_ROWS][3][3] = {{{0}}};
    const double half = seconds / (rows - 1), height = 4.9 * half * half, speed = 2 * height / half;
    for (int i = 0; i < rows; i++) {
        const int is_low = i % 2;
        times[i] = (float)(half * i);
        values[i][1][0] = (float)(1.3 * ball - 1.2 + 0.25 * times[i]);
        values[i][1][1] = (float)(0.3 + (is_low ? 0 : height));
        values[i][1][2] = (float)(2.6 + 0.5 * ball);
        values[i][0][0] = values[i][2][0] = 0.25f;
        values[i][0][1] = (float)(is_low ? -speed : 0);
        values[i][2][1] = (float)(is_low ? speed : 0);
    }
    const int input = glb_put(glb, times, (size_t)rows * sizeof *times, GLB_FLOAT, (uint64_t)rows, "SCALAR");
    glb_put_channel(
        glb, FIRST_BALL + ball, "translation", "CUBICSPLINE", input,
        glb_put(glb, values, (size_t)rows * sizeof *values, GLB_FLOAT, UINT64_C(3) * (uint64_t)rows, "VEC3"));
}

static void put_motion(struct glb *glb)
{
    float times[KEYS];
    for (int i = 0; i < KEYS; i++)
        times[i] = (float)(seconds * i / (KEYS - 1));
    const int input = glb_put(glb, times, sizeof times, GLB_FLOAT, KEYS, "SCALAR");
    put_turn(glb, ROTOR, 2, 2, 0, input);
    put_weights(glb, input);
    put_turn(glb, PLATFORM, 1, 0.5, 0, input);
    for (int i = 0; i < SEATS; i++)
        put_turn(glb, FIRST_SEAT + i, 1, 1, 2 * pi * i / SEATS, input);
    for (int i = 0; i < BALLS; i++)
        put_bounce(glb, i);
}

int fair_write(const char *path, uint32_t size)
{
    struct glb glb;
    glb_init(&glb);
    put_nodes(glb.json);
    put_materials(glb.json);
    put_meshes(&glb, size);
    put_motion(&glb);
    return glb_write(&glb, "fair", path);
}
