/* SPDX-License-Identifier: Apache-2.0 */
/*
 * manifest_nodes.c - takes the nodes out of the text of a manifest. Those of a large scene are most of the text, and
 * as parsed JSON they would take many times its size.
 */
#include <string.h>

#include "client/bvhctl/scene/manifest_internal.h"

enum { NODES_DEPTH = 3 }; /* in an element of "structures" */

static bool is_blank(char character)
{
    return character == ' ' || character == '\t' || character == '\n' || character == '\r';
}

/* Returns the offset behind the text in quotes that begins at `at`, or `size` if it does not end. */
static uint64_t skip_quoted(const char *text, uint64_t size, uint64_t at)
{
    for (at++; at < size && text[at] != '"'; at++)
        if (text[at] == '\\')
            at++;
    return at < size ? at + 1 : size;
}

/* Returns the offset behind the array that begins at `at`, or `size` if it does not end. */
static uint64_t skip_array(const char *text, uint64_t size, uint64_t at)
{
    uint64_t depth = 0;
    while (at < size) {
        char character = text[at];
        if (character == '"') {
            at = skip_quoted(text, size, at);
            continue;
        }
        at++;
        depth += character == '[' || character == '{';
        if ((character == ']' || character == '}') && --depth == 0)
            return at;
    }
    return size;
}

/* Returns the offset of the array behind the key "nodes" at `at`, or 0 if there is another key or value. */
static uint64_t find_nodes(const char *text, uint64_t size, uint64_t at)
{
    static const char key[] = "\"nodes\"";
    if (size - at < sizeof key || memcmp(text + at, key, sizeof key - 1) != 0)
        return 0;
    for (at += sizeof key - 1; at < size && is_blank(text[at]); at++)
        ;
    if (at == size || text[at] != ':')
        return 0;
    for (at++; at < size && is_blank(text[at]); at++)
        ;
    return at < size && text[at] == '[' ? at : 0;
}

/* Copies the text from `at` to `end` to where the result ends. */
static void keep(char *text, uint64_t *used, uint64_t at, uint64_t end)
{
    memmove(text + *used, text + at, end - at);
    *used += end - at;
}

uint64_t manifest_drop_nodes(char *text, uint64_t size)
{
    uint64_t used = 0, kept = 0;
    int depth = 0;
    for (uint64_t at = 0; at < size;) {
        uint64_t nodes = text[at] == '"' && depth == NODES_DEPTH ? find_nodes(text, size, at) : 0;
        if (nodes) {
            keep(text, &used, kept, nodes);
            at = kept = skip_array(text, size, nodes);
            memcpy(text + used, "[]", 2);
            used += 2;
        } else if (text[at] == '"') {
            at = skip_quoted(text, size, at);
        } else {
            depth += text[at] == '{' || text[at] == '[';
            depth -= text[at] == '}' || text[at] == ']';
            at++;
        }
    }
    keep(text, &used, kept, size);
    return used;
}
