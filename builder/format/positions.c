/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/positions.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "builder/format/motion_number.h"

/* A primitive that no record stores. */
#define NO_RECORD UINT32_MAX

struct positions {
    atomic_uint users;
    struct memory *memory;
    enum { HOLDS_OTHERS, HOLDS_INDEXED, HOLDS_TRIANGLES, HOLDS_MOVING, HOLDS_LEAVES } kind;
    uint64_t records_at, vertices_at, geometries_at; /* offsets in the blob; records are the leaves of a native one */
    uint32_t geometry_count, leaf_count;
    uint32_t record_count; /* portable */
    bool is_sparse; /* portable: there is no table, and records are searched */
    uint32_t records[]; /* portable: the record of each primitive, counted through all geometries */
};

static struct positions *make(struct memory *memory, uint32_t rows, struct bvhd_error *error)
{
    struct positions *made = memory_alloc(memory, sizeof *made + (uint64_t)rows * sizeof made->records[0]);
    if (made)
        *made = (struct positions){.users = 1, .memory = memory, .kind = HOLDS_OTHERS};
    else
        bvhd_error_no_memory(error, "data", "no memory to find %" PRIu32 " triangles", rows);
    return made;
}

static uint32_t id_of(enum portable_content content, const unsigned char *records, uint32_t row)
{
    return PORTABLE_ID_MASK &
           (content == PORTABLE_TRIANGLES ? ((const struct portable_triangle *)(const void *)records)[row].id
                                          : ((const struct portable_indexed_triangle *)(const void *)records)[row].id);
}

/*
 * Returns whether most primitives have no record, as in a scene of degenerate triangles: a table would then be much
 * larger than the structure, which may be hostile.
 */
static bool is_sparse(const struct portable_header *header)
{
    return header->primitive_count / 16 > (uint64_t)header->record_count + 4096;
}

/* Fills the table. A triangle whose reference was split has several records, which say the same. */
static void number_records(const struct portable_view *view, uint32_t *records)
{
    memset(records, 0xff, (size_t)view->header->primitive_count * sizeof *records);
    for (uint32_t i = 0; i < view->header->record_count; i++)
        records[id_of((enum portable_content)view->header->content, view->records, i)] = i;
}

static int kind_of(uint32_t content)
{
    return content == PORTABLE_INDEXED_TRIANGLES  ? HOLDS_INDEXED
           : content == PORTABLE_TRIANGLES        ? HOLDS_TRIANGLES
           : content == PORTABLE_MOVING_TRIANGLES ? HOLDS_MOVING
                                                  : HOLDS_OTHERS;
}

enum bvhd_status positions_of_portable(struct bytes blob, const struct portable_view *view, struct memory *memory,
                                       struct positions **ret_positions, struct bvhd_error *error)
{
    const struct portable_header *header = view->header;
    const bool has_triangles = kind_of(header->content) != HOLDS_OTHERS;
    const bool has_table = has_triangles && !is_sparse(header);
    struct positions *made = make(memory, has_table ? header->primitive_count : 0, error);
    if (!made)
        return BVHD_NO_MEMORY;
    if (has_triangles) {
        made->kind = kind_of(header->content);
        made->records_at = (uint64_t)((const unsigned char *)view->records - blob.data);
        made->vertices_at = (uint64_t)((const unsigned char *)view->vertices - blob.data);
        made->geometries_at = (uint64_t)((const unsigned char *)view->geometries - blob.data);
        made->geometry_count = header->geometry_count;
        made->record_count = header->record_count;
        made->is_sparse = !has_table;
        if (has_table)
            number_records(view, made->records);
    }
    *ret_positions = made;
    return BVHD_OK;
}

static uint64_t order_of(uint32_t geometry, uint32_t primitive)
{
    return (uint64_t)geometry << 32 | primitive;
}

static uint64_t order_of_leaf(const struct lavapipe_triangle *leaf)
{
    return order_of(leaf->geometry_and_flags & ~LAVAPIPE_GEOMETRY_OPAQUE, leaf->primitive);
}

/*
 * Returns how many leaves are triangles. Padding may count as one leaf more; it is all 0, so that it does not follow
 * the leaf before it in the order of the request.
 */
static uint32_t count_triangles(const struct lavapipe_view *view)
{
    if (view->leaf_count < 2)
        return view->leaf_count;
    const struct lavapipe_triangle last = lavapipe_triangle_at(view, view->leaf_count - 1),
                                   before = lavapipe_triangle_at(view, view->leaf_count - 2);
    return view->leaf_count - (order_of_leaf(&last) <= order_of_leaf(&before));
}

enum bvhd_status positions_of_lavapipe(struct bytes blob, const struct lavapipe_view *view, struct memory *memory,
                                       struct positions **ret_positions, struct bvhd_error *error)
{
    struct positions *made = make(memory, 0, error);
    if (!made)
        return BVHD_NO_MEMORY;
    if (view->leaf_count > 0 && view->kind == LAVAPIPE_TRIANGLE) {
        made->kind = HOLDS_LEAVES;
        made->records_at = (uint64_t)(view->body - blob.data) + view->leaf_offset;
        made->leaf_count = count_triangles(view);
    }
    *ret_positions = made;
    return BVHD_OK;
}

struct positions *positions_ref(struct positions *positions)
{
    if (positions)
        atomic_fetch_add(&positions->users, 1);
    return positions;
}

void positions_unref(struct positions *positions)
{
    if (positions && atomic_fetch_sub(&positions->users, 1) == 1)
        memory_free(positions->memory, positions);
}

static enum bvhd_status refuse_geometry(uint32_t geometry, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INVALID, "geometry", "the structure has no geometry %" PRIu32, geometry);
}

static enum bvhd_status refuse_primitive(uint32_t geometry, uint32_t primitive, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INVALID, "primitive", "geometry %" PRIu32 " has no primitive %" PRIu32, geometry,
                          primitive);
}

static enum bvhd_status refuse_absent(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INVALID, "primitive",
                          "the structure does not hold it: it is inactive, or has no area or no finite one");
}

/* ---- portable ---- */

static void read_indexed(const struct positions *positions, const unsigned char *blob, uint32_t row,
                         float ret_corners[3][3])
{
    struct portable_indexed_triangle triangle;
    memcpy(&triangle, blob + positions->records_at + row * sizeof triangle, sizeof triangle);
    for (int k = 0; k < 3; k++)
        memcpy(ret_corners[k], blob + positions->vertices_at + triangle.vertices[k] * sizeof(float[3]),
               sizeof(float[3]));
}

static void read_moving(const struct positions *positions, const unsigned char *blob, uint32_t row, float time,
                        float ret_corners[3][3])
{
    const struct motion_weights at = motion_weights_at(time);
    struct portable_indexed_triangle triangle;
    struct portable_moving_vertex vertex;
    memcpy(&triangle, blob + positions->records_at + row * sizeof triangle, sizeof triangle);
    for (int k = 0; k < 3; k++) {
        memcpy(&vertex, blob + positions->vertices_at + triangle.vertices[k] * sizeof vertex, sizeof vertex);
        for (int axis = 0; axis < 3; axis++)
            ret_corners[k][axis] = motion_number(vertex.start[axis], vertex.end[axis], at);
    }
}

static void read_triangle(const struct positions *positions, const unsigned char *blob, uint32_t row,
                          float ret_corners[3][3])
{
    struct portable_triangle triangle;
    memcpy(&triangle, blob + positions->records_at + row * sizeof triangle, sizeof triangle);
    memcpy(ret_corners[0], triangle.v0, sizeof triangle.v0);
    memcpy(ret_corners[1], triangle.v1, sizeof triangle.v1);
    memcpy(ret_corners[2], triangle.v2, sizeof triangle.v2);
}

static uint32_t find_record(const struct positions *positions, const unsigned char *blob, uint32_t id)
{
    const enum portable_content content =
        positions->kind == HOLDS_TRIANGLES ? PORTABLE_TRIANGLES : PORTABLE_INDEXED_TRIANGLES;
    if (!positions->is_sparse)
        return positions->records[id];
    for (uint32_t i = 0; i < positions->record_count; i++)
        if (id_of(content, blob + positions->records_at, i) == id)
            return i;
    return NO_RECORD;
}

static enum bvhd_status get_portable(const struct positions *positions, const unsigned char *blob, uint32_t geometry,
                                     uint32_t primitive, const float *time, float ret_corners[3][3],
                                     struct bvhd_error *error)
{
    struct portable_geometry row;
    if (geometry >= positions->geometry_count)
        return refuse_geometry(geometry, error);
    memcpy(&row, blob + positions->geometries_at + geometry * sizeof row, sizeof row);
    if (primitive >= row.primitive_count)
        return refuse_primitive(geometry, primitive, error);
    const uint32_t record = find_record(positions, blob, row.first_primitive + primitive);
    if (record == NO_RECORD)
        return refuse_absent(error);
    if (positions->kind == HOLDS_INDEXED)
        read_indexed(positions, blob, record, ret_corners);
    else if (positions->kind == HOLDS_MOVING)
        read_moving(positions, blob, record, *time, ret_corners);
    else
        read_triangle(positions, blob, record, ret_corners);
    return BVHD_OK;
}

/* ---- native ---- */

static struct lavapipe_triangle leaf_at(const struct positions *positions, const unsigned char *blob, uint32_t leaf)
{
    struct lavapipe_triangle triangle;
    memcpy(&triangle, blob + positions->records_at + leaf * sizeof triangle, sizeof triangle);
    return triangle;
}

/*
 * Finds the first leaf that is not before a primitive of the request; leaf_count if all are. Leaves that no box refers
 * to were checked by nobody: if they are out of order the answer is any leaf.
 */
static uint32_t find_leaf(const struct positions *positions, const unsigned char *blob, uint64_t wanted)
{
    uint32_t first = 0, end = positions->leaf_count;
    while (first < end) {
        const uint32_t middle = first + (end - first) / 2;
        const struct lavapipe_triangle leaf = leaf_at(positions, blob, middle);
        if (order_of_leaf(&leaf) < wanted)
            first = middle + 1;
        else
            end = middle;
    }
    return first;
}

static bool has_nan(float corners[3][3])
{
    for (int k = 0; k < 9; k++)
        if (isnan(corners[k / 3][k % 3]))
            return true;
    return false;
}

static enum bvhd_status get_leaf(const struct positions *positions, const unsigned char *blob, uint32_t geometry,
                                 uint32_t primitive, float ret_corners[3][3], struct bvhd_error *error)
{
    const uint32_t leaf = find_leaf(positions, blob, order_of(geometry, primitive));
    struct lavapipe_triangle triangle = {.primitive = ~primitive};
    if (leaf < positions->leaf_count)
        triangle = leaf_at(positions, blob, leaf);
    if (triangle.primitive != primitive || (triangle.geometry_and_flags & ~LAVAPIPE_GEOMETRY_OPAQUE) != geometry)
        return refuse_primitive(geometry, primitive, error);
    if (has_nan(triangle.corners))
        return refuse_absent(error);
    memcpy(ret_corners, triangle.corners, sizeof triangle.corners);
    return BVHD_OK;
}

enum bvhd_status positions_get(const struct positions *positions, const unsigned char *blob, uint32_t geometry,
                               uint32_t primitive, const float *time, float ret_corners[3][3], struct bvhd_error *error)
{
    if (positions->kind == HOLDS_OTHERS)
        return bvhd_error_set(error, BVHD_INVALID, "geometry", "the structure holds no triangles");
    if (positions->kind == HOLDS_MOVING && !time)
        return bvhd_error_set(error, BVHD_INVALID, "geometry",
                              "the triangles of the structure move: their positions are those of a time");
    if (positions->kind == HOLDS_LEAVES)
        return get_leaf(positions, blob, geometry, primitive, ret_corners, error);
    return get_portable(positions, blob, geometry, primitive, time, ret_corners, error);
}
