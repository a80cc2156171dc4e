/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/ply_header.h"

#include <string.h>

enum { LINE_SIZE = 512, WORDS_MAX = 6 };

/* The header while it is read. */
struct reading {
    struct ply_source *source;
    const char *path;
    struct ply_header *header;
    struct bvhd_error *error;
    bool has_cr_lines; /* lines end with CR alone, so that an LF after the last one belongs to the data */
    bool has_format;
    bool is_cut; /* the line is longer than the buffer */
    char line[LINE_SIZE];
    char *words[WORDS_MAX]; /* of the line */
    int word_count; /* WORDS_MAX + 1: more */
};

#define FAIL(reading, status, ...) bvhd_error_set((reading)->error, (status), (reading)->path, __VA_ARGS__)

static unsigned long long line_number(const struct reading *reading)
{
    return (unsigned long long)reading->source->line;
}

static void end_line(struct reading *reading, int character)
{
    struct ply_source *source = reading->source;
    source->at++;
    bool is_followed = character == '\r' && ply_source_peek(source) == '\n';
    if (is_followed && !reading->has_cr_lines)
        source->at++;
    if (source->line == 1)
        reading->has_cr_lines = character == '\r' && !is_followed;
}

static void split_words(struct reading *reading)
{
    char *rest = NULL, *word = strtok_r(reading->line, " \t", &rest);
    reading->word_count = 0;
    for (; word && reading->word_count <= WORDS_MAX; word = strtok_r(NULL, " \t", &rest)) {
        if (reading->word_count < WORDS_MAX)
            reading->words[reading->word_count] = word;
        reading->word_count++;
    }
}

/* Reads a line and splits it. Returns false at the end of the file. */
static bool read_line(struct reading *reading)
{
    size_t length = 0;
    int next;
    while ((next = ply_source_peek(reading->source)) >= 0 && next != '\n' && next != '\r') {
        if (length + 1 < sizeof reading->line)
            reading->line[length++] = (char)next;
        else
            reading->is_cut = true;
        reading->source->at++;
    }
    if (next < 0)
        return false;
    reading->line[length] = '\0';
    end_line(reading, next);
    split_words(reading);
    return true;
}

static bool find_type(const char *name, enum ply_type *ret_type)
{
    static const struct {
        const char *name;
        enum ply_type type;
    } types[] = {
        {"char", PLY_INT8},      {"int8", PLY_INT8},       {"uchar", PLY_UINT8},   {"uint8", PLY_UINT8},
        {"short", PLY_INT16},    {"int16", PLY_INT16},     {"ushort", PLY_UINT16}, {"uint16", PLY_UINT16},
        {"int", PLY_INT32},      {"int32", PLY_INT32},     {"uint", PLY_UINT32},   {"uint32", PLY_UINT32},
        {"int64", PLY_INT64},    {"uint64", PLY_UINT64},   {"float", PLY_FLOAT32}, {"float32", PLY_FLOAT32},
        {"double", PLY_FLOAT64}, {"float64", PLY_FLOAT64},
    };
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (!strcmp(name, types[i].name)) {
            *ret_type = types[i].type;
            return true;
        }
    return false;
}

static enum bvhd_status read_format(struct reading *reading)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    if (reading->word_count != 3)
        return FAIL(reading, BVHD_INVALID, "line %llu of the header has no format and version", line_number(reading));
    int format = PLY_ASCII;
    while (format <= PLY_BIG_ENDIAN && strcmp(reading->words[1], names[format]) != 0)
        format++;
    if (format > PLY_BIG_ENDIAN)
        return FAIL(reading, BVHD_UNSUPPORTED, "PLY has no format '%s'", reading->words[1]);
    if (strcmp(reading->words[2], "1.0") != 0)
        return FAIL(reading, BVHD_UNSUPPORTED, "version %s of PLY is not known, only 1.0", reading->words[2]);
    if (reading->has_format)
        return FAIL(reading, BVHD_INVALID, "the header has two formats");
    reading->source->format = (enum ply_format)format;
    reading->has_format = true;
    return BVHD_OK;
}

static bool parse_count(const char *text, uint64_t *ret_count)
{
    uint64_t count = 0;
    size_t length = strlen(text);
    if (length == 0 || length > 18)
        return false;
    for (; *text; text++) {
        if (*text < '0' || *text > '9')
            return false;
        count = count * 10 + (uint64_t)(*text - '0');
    }
    *ret_count = count;
    return true;
}

static enum bvhd_status copy_name(struct reading *reading, const char *name, char ret_name[PLY_NAME_SIZE])
{
    if (strlen(name) >= PLY_NAME_SIZE)
        return FAIL(reading, BVHD_UNSUPPORTED, "line %llu of the header has a name of more than %d characters",
                    line_number(reading), PLY_NAME_SIZE - 1);
    strcpy(ret_name, name);
    return BVHD_OK;
}

static enum bvhd_status read_element(struct reading *reading)
{
    struct ply_header *header = reading->header;
    if (header->element_count == PLY_ELEMENTS_MAX)
        return FAIL(reading, BVHD_UNSUPPORTED, "the header has more than %d elements", PLY_ELEMENTS_MAX);
    struct ply_element *element = &header->elements[header->element_count];
    *element = (struct ply_element){.properties = &header->properties[header->property_count]};
    if (reading->word_count != 3 || !parse_count(reading->words[2], &element->count))
        return FAIL(reading, BVHD_INVALID, "line %llu of the header has no name and number of an element",
                    line_number(reading));
    if (ply_header_find(header, reading->words[1]))
        return FAIL(reading, BVHD_INVALID, "element '%s' is in the header twice", reading->words[1]);
    header->element_count++;
    return copy_name(reading, reading->words[1], element->name);
}

static enum bvhd_status add_property(struct reading *reading, struct ply_element *element,
                                     const struct ply_property *property)
{
    struct ply_header *header = reading->header;
    struct ply_property *added = &header->properties[header->property_count];
    if (header->property_count == PLY_PROPERTIES_MAX)
        return FAIL(reading, BVHD_UNSUPPORTED, "the header has more than %d properties", PLY_PROPERTIES_MAX);
    *added = *property;
    enum bvhd_status status = copy_name(reading, reading->words[reading->word_count - 1], added->name);
    if (status)
        return status;
    if (ply_element_find(element, added->name) >= 0)
        return FAIL(reading, BVHD_INVALID, "element '%s' has property '%s' twice", element->name, added->name);
    header->property_count++;
    element->property_count++;
    return BVHD_OK;
}

static enum bvhd_status read_property(struct reading *reading)
{
    struct ply_header *header = reading->header;
    char *const *words = reading->words;
    if (header->element_count == 0)
        return FAIL(reading, BVHD_INVALID, "line %llu of the header has a property without an element",
                    line_number(reading));
    struct ply_property property = {.is_list = reading->word_count > 1 && !strcmp(words[1], "list")};
    if (reading->word_count != (property.is_list ? 5 : 3))
        return FAIL(reading, BVHD_INVALID, "line %llu of the header is not a property with its type",
                    line_number(reading));
    const char *unknown = NULL;
    if (property.is_list && !find_type(words[2], &property.count_type))
        unknown = words[2];
    else if (!find_type(words[reading->word_count - 2], &property.type))
        unknown = words[reading->word_count - 2];
    if (unknown)
        return FAIL(reading, BVHD_UNSUPPORTED, "PLY has no type '%s'", unknown);
    if (property.is_list && property.count_type >= PLY_FLOAT32)
        return FAIL(reading, BVHD_INVALID, "the length of list '%s' is no integer", words[4]);
    return add_property(reading, &header->elements[header->element_count - 1], &property);
}

/* Reads a line after the first one. */
static enum bvhd_status read_statement(struct reading *reading)
{
    const char *word = reading->word_count ? reading->words[0] : "comment";
    if (!strcmp(word, "comment") || !strcmp(word, "obj_info"))
        return BVHD_OK;
    if (reading->is_cut)
        return FAIL(reading, BVHD_INVALID, "line %llu of the header is too long", line_number(reading));
    if (!strcmp(word, "format"))
        return read_format(reading);
    if (!strcmp(word, "element"))
        return read_element(reading);
    if (!strcmp(word, "property"))
        return read_property(reading);
    if (reading->header->element_count == 0) { /* some writers begin with a comment that is not marked as one */
        reading->header->unknown_lines++;
        return BVHD_OK;
    }
    return FAIL(reading, BVHD_INVALID, "line %llu of the header begins with '%.40s', which PLY does not know",
                line_number(reading), word);
}

static enum bvhd_status read_lines(struct reading *reading)
{
    for (;;) {
        reading->is_cut = false;
        reading->source->line++;
        if (!read_line(reading))
            return FAIL(reading, BVHD_INVALID, "the file is cut off in the header, in line %llu", line_number(reading));
        if (reading->word_count && !strcmp(reading->words[0], "end_header"))
            break;
        enum bvhd_status status = read_statement(reading);
        if (status)
            return status;
    }
    reading->source->line++;
    if (!reading->has_format)
        return FAIL(reading, BVHD_INVALID, "the header has no format");
    return BVHD_OK;
}

enum bvhd_status ply_header_read(struct ply_source *source, const char *path, struct ply_header *ret_header,
                                 struct bvhd_error *error)
{
    struct reading reading = {.source = source, .path = path, .header = ret_header, .error = error};
    ret_header->element_count = ret_header->property_count = ret_header->unknown_lines = 0;
    if (!read_line(&reading) || reading.word_count != 1 || strcmp(reading.words[0], "ply") != 0)
        return FAIL(&reading, BVHD_INVALID, "it does not begin with a line that says 'ply'");
    return read_lines(&reading);
}

const struct ply_element *ply_header_find(const struct ply_header *header, const char *name)
{
    for (uint32_t i = 0; i < header->element_count; i++)
        if (!strcmp(header->elements[i].name, name))
            return &header->elements[i];
    return NULL;
}

int ply_element_find(const struct ply_element *element, const char *name)
{
    for (uint32_t i = 0; i < element->property_count; i++)
        if (!strcmp(element->properties[i].name, name))
            return (int)i;
    return -1;
}

uint64_t ply_element_row_size(const struct ply_element *element, enum ply_format format)
{
    uint64_t size = 0;
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &element->properties[i];
        if (format == PLY_ASCII)
            size += 2; /* a digit, and what separates it from the next value */
        else
            size += ply_type_size(property->is_list ? property->count_type : property->type);
    }
    return size;
}

bool ply_element_is_fixed(const struct ply_element *element, enum ply_format format)
{
    for (uint32_t i = 0; i < element->property_count; i++)
        if (element->properties[i].is_list)
            return false;
    return format != PLY_ASCII;
}
