/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/scene_case.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/gltf_case.h"
#include "tests/support/scene/ply_file.h"

/* Sets the count whose kind has this name. */
static void set_count(struct import_counts *counts, const char *kind, uint64_t number)
{
    struct {
        const char *name;
        uint64_t *count;
    } kinds[] = {{"points", &counts->points},         {"lines", &counts->lines},
                 {"skins", &counts->skins},           {"morphs", &counts->morphs},
                 {"incomplete", &counts->incomplete}, {"positionless", &counts->positionless},
                 {"nodes", &counts->nodes},           {"meshes", &counts->meshes},
                 {"bounds", &counts->bounds},         {"extensions", &counts->extensions},
                 {"animations", &counts->animations}, {"channels", &counts->channels},
                 {"unmoved", &counts->unmoved}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (!strcmp(kinds[i].name, kind)) {
            *kinds[i].count = number;
            return;
        }
    abort();
}

/* A case of gltf_case.h, as a GLB. */
static void make_gltf(const struct gltf_case *source, struct scene_case *ret_case)
{
    static const float none[3] = {0}, quad_high[3] = {2, 3, 0};
    _Static_assert((int)GLTF_CASE_ROOM <= (int)SCENE_CASE_ROOM, "a case has room");
    struct scene_expected *expected = &ret_case->expected;
    bool is_quad = !memcmp(source->low, none, sizeof none) && !memcmp(source->high, none, sizeof none);
    ret_case->format = "glTF";
    snprintf(ret_case->name, sizeof ret_case->name, "%s", source->name);
    strcpy(ret_case->file, "case.glb");
    ret_case->size = gltf_case_make(source, ret_case->bytes);
    ret_case->scene = source->scene;
    ret_case->at = source->at;
    ret_case->until = source->until;
    ret_case->animation = source->animation;
    ret_case->status = source->status;
    ret_case->text = source->text;
    expected->triangles = source->triangles ? source->triangles : 2;
    expected->instances = source->instances ? source->instances : 1;
    expected->skipped = source->skipped;
    memcpy(expected->low, source->low, sizeof expected->low);
    memcpy(expected->high, is_quad ? quad_high : source->high, sizeof expected->high);
    if (source->kind)
        set_count(&expected->counts, source->kind, source->count);
}

/* A sample of ply_file.h. */
static void make_ply(uint32_t index, struct scene_case *ret_case)
{
    static const char *const names[] = {"triangles",       "polygons before vertices",    "other elements, any order",
                                        "triangle strips", "faces of 0, 1 and 2 corners", "strips and faces, CR LF"};
    static const char *const formats[] = {"ASCII", "little-endian", "big-endian"};
    struct ply_file file;
    struct ply_expected found;
    ply_file_sample(index, &file, &found);
    struct scene_expected *expected = &ret_case->expected;
    ret_case->format = "PLY";
    snprintf(ret_case->name, sizeof ret_case->name, "%s, %s", names[index / PLY_FILE_FORMATS],
             formats[index % PLY_FILE_FORMATS]);
    strcpy(ret_case->file, "case.ply");
    memcpy(ret_case->bytes, file.bytes, file.size);
    ret_case->size = file.size;
    expected->triangles = found.triangles;
    expected->instances = 1;
    expected->has_spare_vertices = true;
    memcpy(expected->low, found.min, sizeof expected->low);
    memcpy(expected->high, found.max, sizeof expected->high);
    expected->counts = (struct import_counts){.points = found.points,
                                              .lines = found.lines,
                                              .empty_faces = found.empty_faces,
                                              .unknown_rows = found.unknown_rows};
}

static void make_text(const struct scene_text *source, struct scene_case *ret_case)
{
    size_t size = source->size ? source->size : strlen(source->text);
    if (size > sizeof ret_case->bytes)
        abort();
    ret_case->format = source->format;
    snprintf(ret_case->name, sizeof ret_case->name, "%s", source->name);
    snprintf(ret_case->file, sizeof ret_case->file, "%s", source->file);
    memcpy(ret_case->bytes, source->text, size);
    ret_case->size = size;
    for (size_t i = 0; i < size && !source->size && !strcmp(source->format, "glTF"); i++)
        ret_case->bytes[i] = ret_case->bytes[i] == '\'' ? '"' : ret_case->bytes[i];
    ret_case->second = source->second;
    ret_case->second_bytes = source->second_bytes;
    ret_case->second_size = source->second_size;
    ret_case->is_endless = source->is_endless;
    ret_case->status = source->status;
    ret_case->text = source->error;
    ret_case->expected = (struct scene_expected){.triangles = source->triangles,
                                                 .instances = source->instances ? source->instances : 1,
                                                 .may_lose = source->may_lose,
                                                 .counts = source->counts};
    memcpy(ret_case->expected.low, source->low, sizeof source->low);
    memcpy(ret_case->expected.high, source->high, sizeof source->high);
}

uint32_t scene_case_count(void)
{
    return gltf_case_count + PLY_FILE_SAMPLES + scene_text_count;
}

void scene_case_make(uint32_t index, struct scene_case *ret_case)
{
    memset(ret_case, 0, sizeof *ret_case);
    if (index < gltf_case_count)
        make_gltf(&gltf_cases[index], ret_case);
    else if (index < gltf_case_count + PLY_FILE_SAMPLES)
        make_ply(index - gltf_case_count, ret_case);
    else
        make_text(&scene_texts[index - gltf_case_count - PLY_FILE_SAMPLES], ret_case);
}

size_t scene_case_sample(const char *format, uint32_t index, uint8_t ret_bytes[SCENE_CASE_ROOM])
{
    static struct scene_case scene_case;
    for (uint32_t i = 0, found = 0; i < scene_case_count(); i++) {
        scene_case_make(i, &scene_case);
        if (strcmp(scene_case.format, format) != 0 || scene_case.second || !scene_case.size || found++ != index)
            continue;
        memcpy(ret_bytes, scene_case.bytes, scene_case.size);
        return scene_case.size;
    }
    return 0;
}
