/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/notes.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/report.h"
#include "client/bvhctl/scene/activity.h"

enum { MESHES_NAMED = 3, LIST_SIZE = 256, NAME_MAX_SHOWN = 40 };

/* Numbers of one kind, one for each mesh of an import. */
struct mesh_numbers {
    const struct import *import;
    uint64_t *numbers; /* NULL: there is no memory for a list */
};

static struct mesh_numbers numbers_open(const struct import *import)
{
    struct mesh_numbers list = {import, memory_array(import->memory, import->mesh_count, sizeof *list.numbers)};
    if (list.numbers)
        memset(list.numbers, 0, import->mesh_count * sizeof *list.numbers);
    return list;
}

static void numbers_close(struct mesh_numbers *list)
{
    memory_free(list->import->memory, list->numbers);
}

/* Takes the largest number out of the list. Returns false when all are 0. */
static bool take_largest(const struct mesh_numbers *list, uint32_t *ret_mesh, uint64_t *ret_number)
{
    *ret_mesh = 0;
    for (uint32_t i = 1; i < list->import->mesh_count; i++)
        if (list->numbers[i] > list->numbers[*ret_mesh])
            *ret_mesh = i;
    *ret_number = list->numbers[*ret_mesh];
    list->numbers[*ret_mesh] = 0;
    return *ret_number > 0;
}

/*
 * Writes " (mesh 'a': 3, mesh 'b': 2, others: 7)" and empties the list. The text is empty if the scene has only one
 * mesh, or if the numbers are not about meshes.
 */
static void write_meshes(const struct mesh_numbers *list, char ret_text[LIST_SIZE])
{
    uint64_t number, others = 0;
    uint32_t mesh;
    size_t used = 0;
    ret_text[0] = '\0';
    if (!list->numbers || list->import->mesh_count < 2)
        return;
    for (int i = 0; i < MESHES_NAMED && take_largest(list, &mesh, &number); i++) {
        const char *name = list->import->meshes[mesh].name;
        used += (size_t)snprintf(ret_text + used, LIST_SIZE - used, "%smesh ", i ? ", " : " (");
        if (*name)
            used += (size_t)snprintf(ret_text + used, LIST_SIZE - used, "'%.*s'", NAME_MAX_SHOWN, name);
        else
            used += (size_t)snprintf(ret_text + used, LIST_SIZE - used, "%u", mesh);
        used += (size_t)snprintf(ret_text + used, LIST_SIZE - used, ": %llu", (unsigned long long)number);
    }
    for (uint32_t i = 0; i < list->import->mesh_count; i++)
        others += list->numbers[i];
    if (others)
        used += (size_t)snprintf(ret_text + used, LIST_SIZE - used, ", others: %llu", (unsigned long long)others);
    if (used)
        snprintf(ret_text + used, LIST_SIZE - used, ")");
}

static void note_kind(const struct import *import, int kind)
{
    char meshes[LIST_SIZE];
    uint64_t count = import_counts_get(&import->counts, kind);
    struct mesh_numbers list = numbers_open(import);
    for (uint32_t i = 0; i < import->mesh_count && list.numbers; i++)
        list.numbers[i] = import_counts_get(&import->meshes[i].counts, kind);
    write_meshes(&list, meshes);
    numbers_close(&list);
    const struct import_count_kind *texts = &import_count_kinds[kind];
    report_note(import->name, "%llu %s%s%s%s%s", (unsigned long long)count, count == 1 ? texts->one : texts->many,
                meshes, texts->option ? "; " : "", texts->option ? texts->option : "",
                !texts->option ? ""
                : count == 1   ? " RADIUS reads it"
                               : " RADIUS reads them");
}

void notes_left_out(const struct import *import)
{
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        if (import_counts_get(&import->counts, i))
            note_kind(import, i);
    if (import->skipped_instances)
        report_note(import->name, "%llu %s no inverse (%s)", (unsigned long long)import->skipped_instances,
                    import->skipped_instances == 1 ? "instance made inactive: its matrix has"
                                                   : "instances made inactive: their matrices have",
                    bvhd_vuid_string(BVHD_VUID_03799));
}

/* Says how far something is from the animation, and when. */
static void note_deviation(const struct import *import, const struct import_deviation *deviation, const char *things,
                           const char *thing, const char *name)
{
    char subject[NAME_MAX_SHOWN + 32];
    if (*name)
        snprintf(subject, sizeof subject, "%s '%.*s'", thing, NAME_MAX_SHOWN, name);
    else
        snprintf(subject, sizeof subject, "a %s without a name", thing);
    if (deviation->distance > 0)
        report_note(import->name, "%s are at most %.3g from where the animation has them: %s, at %g s", things,
                    deviation->distance, subject, deviation->time);
}

void notes_motion(const struct import *import)
{
    uint32_t turning = import_turning_count(import), others = import->motion_count - turning;
    if (!import->is_shutter)
        return;
    if (!import->motion_count && !import->moving_meshes)
        report_note(import->name, "nothing moves from %g s to %g s", import->time, import->end_time);
    else
        report_note(import->name,
                    "from %g s to %g s %u instance%s move%s by SRT and %u by matrices, and the triangles of %u mesh%s "
                    "move",
                    import->time, import->end_time, turning, turning == 1 ? "" : "s", turning == 1 ? "s" : "", others,
                    import->moving_meshes, import->moving_meshes == 1 ? "" : "es");
    note_deviation(import, &import->instance_deviation, "instances", "node",
                   import_names_get(&import->node_names, import->instance_deviation.which));
    note_deviation(import, &import->vertex_deviation, "vertices", "mesh",
                   import->meshes[import->vertex_deviation.which].name);
}

/* The defects of triangles, in the order of struct activity. */
enum defect { INACTIVE, DEGENERATE, INFINITE };

static void note_defect(const struct import *import, enum defect defect, uint64_t count)
{
    static const char *const one[] = {"triangle is inactive, because a corner is not a number",
                                      "triangle is degenerate: it has no area",
                                      "triangle has a corner that is not finite"};
    static const char *const many[] = {"triangles are inactive, because a corner is not a number",
                                       "triangles are degenerate: they have no area",
                                       "triangles have a corner that is not finite"};
    char meshes[LIST_SIZE];
    if (!count)
        return;
    struct mesh_numbers list = numbers_open(import);
    for (uint32_t i = 0; i < import->mesh_count && import->mesh_count > 1 && list.numbers; i++) {
        struct activity activity = activity_of(&import->meshes[i]);
        list.numbers[i] = defect == INACTIVE     ? activity.inactive
                          : defect == DEGENERATE ? activity.degenerate
                                                 : activity.infinite;
    }
    write_meshes(&list, meshes);
    numbers_close(&list);
    report_note(import->name, "%llu %s%s", (unsigned long long)count, count == 1 ? one[defect] : many[defect], meshes);
}

void notes_activity(const struct assembly *assembly)
{
    const struct import *import = assembly->import;
    uint64_t inactive = 0, degenerate = 0, skipped = 0, hidden = 0, triangles = 0;
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        const struct bvhd_result *item = &assembly->items[i];
        triangles += item->primitives;
        inactive += item->inactive;
        degenerate += item->degenerate;
        skipped += item->skipped > item->degenerate ? item->skipped - item->degenerate : 0;
        hidden += item->inactive + (item->skipped > item->degenerate ? item->skipped : item->degenerate);
    }
    note_defect(import, INACTIVE, inactive);
    note_defect(import, DEGENERATE, degenerate);
    note_defect(import, INFINITE, skipped);
    if (triangles && hidden == triangles)
        report_note(import->name, "warning: no ray can hit anything in it, because this is so for all its triangles");
    else if (import->skipped_instances == import->instance_count)
        report_note(import->name, "warning: no ray can hit anything in it, because all its instances are inactive");
}
