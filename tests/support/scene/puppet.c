/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/puppet.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_sampler.h"

static void must(bool holds)
{
    if (!holds)
        abort();
}

static void make_track(struct random *random, int width, struct puppet_track *track)
{
    bool is_rotation = width == 4;
    *track = (struct puppet_track){.interpolation = (int)(random_next(random) % 3), .width = width};
    for (int key = 0; key < PUPPET_KEYS; key++)
        track->times[key] = (float)(key ? track->times[key - 1] + 0.2 + fabs(random_between(random, -1, 1))
                                        : fabs(random_between(random, -1, 1)));
    for (int i = 0; i < 3 * PUPPET_KEYS; i++) {
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

void puppet_make(struct random *random, struct puppet *puppet)
{
    for (int i = 0; i < PUPPET_JOINTS; i++) {
        make_track(random, 3, &puppet->moves[i]);
        make_track(random, 4, &puppet->turns[i]);
        make_track(random, 3, &puppet->scales[i]);
        for (int k = 0; k < 16; k++)
            puppet->binds[i][k] = k % 4 == 3 ? (float)(k == 15) : (float)random_between(random, -1, 1);
    }
    make_track(random, PUPPET_TARGETS, &puppet->weights);
    for (int i = 0; i < PUPPET_VERTICES; i++)
        for (int k = 0; k < 4; k++) {
            for (int t = 0; t < PUPPET_TARGETS && k < 3; t++)
                puppet->targets[t][i][k] = (float)random_between(random, -1, 1);
            if (k < 3)
                puppet->positions[i][k] = (float)random_between(random, -1, 1);
            for (int set = 0; set < PUPPET_SETS; set++) {
                puppet->joints[set][i][k] = (uint8_t)(random_next(random) % PUPPET_JOINTS);
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
    must(strlen(text) + 1 < room);
}

static int put(struct writer *writer, const void *data, size_t size, int component, int count, const char *type)
{
    must(writer->size + size <= sizeof writer->bin);
    memcpy(writer->bin + writer->size, data, size);
    append(writer->views, sizeof writer->views, "%s{'buffer':0,'byteOffset':%zu,'byteLength':%zu}",
           writer->count ? "," : "", writer->size, size);
    append(writer->accessors, sizeof writer->accessors, "%s{'bufferView':%d,'componentType':%d,'count':%d,'type':'%s'}",
           writer->count ? "," : "", writer->count, component, count, type);
    writer->size += size;
    return writer->count++;
}

static void put_track(struct writer *writer, const struct puppet_track *track, int node, const char *path)
{
    static const char *const names[] = {"LINEAR", "STEP", "CUBICSPLINE"}, *const types[] = {"SCALAR", "VEC3", "VEC4"};
    float values[3 * PUPPET_KEYS * 4];
    int rows = PUPPET_KEYS * (track->interpolation == GLTF_CUBICSPLINE ? 3 : 1);
    for (int i = 0; i < rows; i++)
        memcpy(values + i * track->width, track->values[i], (size_t)track->width * sizeof(float));
    bool are_weights = track->width == PUPPET_TARGETS;
    int input = put(writer, track->times, sizeof track->times, 5126, PUPPET_KEYS, "SCALAR");
    int output = put(writer, values, (size_t)(rows * track->width) * sizeof(float), 5126,
                     are_weights ? rows * track->width : rows, types[are_weights ? 0 : track->width - 2]);
    append(writer->channels, sizeof writer->channels, "%s{'sampler':%d,'target':{'node':%d,'path':'%s'}}",
           writer->sampler_count ? "," : "", writer->sampler_count, node, path);
    append(writer->samplers, sizeof writer->samplers, "%s{'input':%d,'output':%d,'interpolation':'%s'}",
           writer->sampler_count ? "," : "", input, output, names[track->interpolation]);
    writer->sampler_count++;
}

size_t puppet_write(const struct puppet *puppet, bool is_skinned, uint8_t ret_bytes[GLTF_CASE_ROOM])
{
    static struct writer writer;
    static char json[GLTF_CASE_ROOM];
    uint16_t indices[PUPPET_VERTICES];
    writer = (struct writer){0};
    for (int i = 0; i < PUPPET_VERTICES; i++)
        indices[i] = (uint16_t)i;
    put(&writer, puppet->positions, sizeof puppet->positions, 5126, PUPPET_VERTICES, "VEC3");
    put(&writer, indices, sizeof indices, 5123, PUPPET_VERTICES, "SCALAR");
    for (int i = 0; i < PUPPET_TARGETS; i++)
        put(&writer, puppet->targets[i], sizeof puppet->targets[i], 5126, PUPPET_VERTICES, "VEC3");
    for (int i = 0; i < PUPPET_SETS; i++) {
        put(&writer, puppet->joints[i], sizeof puppet->joints[i], 5121, PUPPET_VERTICES, "VEC4");
        put(&writer, puppet->shares[i], sizeof puppet->shares[i], 5126, PUPPET_VERTICES, "VEC4");
    }
    int binds = put(&writer, puppet->binds, sizeof puppet->binds, 5126, PUPPET_JOINTS, "MAT4");
    for (int i = 0; i < PUPPET_JOINTS; i++) {
        put_track(&writer, &puppet->moves[i], i + 1, "translation");
        put_track(&writer, &puppet->turns[i], i + 1, "rotation");
        put_track(&writer, &puppet->scales[i], i + 1, "scale");
    }
    if (is_skinned)
        put_track(&writer, &puppet->weights, 0, "weights");
    int length = snprintf(
        json, sizeof json,
        "{'asset':{'version':'2.0'},'scenes':[{'nodes':[%s1]}],'nodes':[%s,{'children':[2]},{'children':[3]},"
        "{'children':[4]},%s],'skins':[{'joints':[1,2,3,4],'inverseBindMatrices':%d}],'meshes':[{'primitives':[{"
        "'attributes':{'POSITION':0%s},'indices':1%s}]}],'animations':[{'channels':[%s],'samplers':[%s]}],"
        "'buffers':[{'byteLength':%zu}],'bufferViews':[%s],'accessors':[%s]}",
        is_skinned ? "0," : "", is_skinned ? "{'mesh':0,'skin':0,'scale':[9,9,9]}" : "{'mesh':0}",
        is_skinned ? "{}" : "{'children':[0]}", binds,
        is_skinned ? ",'JOINTS_0':4,'WEIGHTS_0':5,'JOINTS_1':6,'WEIGHTS_1':7" : "",
        is_skinned ? ",'targets':[{'POSITION':2},{'POSITION':3}]" : "", writer.channels, writer.samplers, writer.size,
        writer.views, writer.accessors);
    must(length < (int)sizeof json);
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

static void evaluate(const struct puppet_track *track, double time, double ret[4])
{
    int step = track->interpolation == GLTF_CUBICSPLINE ? 3 : 1, at = step == 3 ? 1 : 0, key = 0;
    while (key + 1 < PUPPET_KEYS && track->times[key + 1] <= time)
        key++;
    bool is_still = time <= track->times[0] || key + 1 == PUPPET_KEYS || track->interpolation == GLTF_STEP;
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

void puppet_carry(const struct puppet *puppet, int joint, double time, double point[3])
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

void puppet_vertex(const struct puppet *puppet, int vertex, double time, double ret[3])
{
    double weights[4], sum = 0, start[3];
    evaluate(&puppet->weights, time, weights);
    for (int k = 0; k < 3; k++) {
        start[k] = puppet->positions[vertex][k];
        for (int t = 0; t < PUPPET_TARGETS; t++)
            start[k] += weights[t] * puppet->targets[t][vertex][k];
        ret[k] = 0;
    }
    for (int i = 0; i < 4 * PUPPET_SETS; i++) {
        int joint = puppet->joints[i / 4][vertex][i % 4];
        double share = puppet->shares[i / 4][vertex][i % 4], point[3];
        for (int k = 0; k < 3; k++) {
            const float *columns = puppet->binds[joint];
            point[k] = columns[k] * start[0] + columns[4 + k] * start[1] + columns[8 + k] * start[2] + columns[12 + k];
        }
        puppet_carry(puppet, joint, time, point);
        for (int k = 0; k < 3; k++)
            ret[k] += share * point[k];
        sum += share;
    }
    for (int k = 0; k < 3; k++)
        ret[k] /= sum;
}
