/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_uri.h"

#include <ctype.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>

/* Returns the length of a scheme such as "https" before a colon; 0: there is none. */
static size_t scheme_length(const char *uri)
{
    size_t length = 0;
    if (!isalpha((unsigned char)uri[0]))
        return 0;
    while (isalnum((unsigned char)uri[length]) || (uri[length] && strchr("+-.", uri[length])))
        length++;
    return uri[length] == ':' ? length : 0;
}

enum gltf_uri_kind gltf_uri_kind(const char *uri)
{
    size_t length = scheme_length(uri);
    if (length == 4 && !strncmp(uri, "data", 4))
        return GLTF_URI_DATA;
    return length > 1 ? GLTF_URI_REMOTE : GLTF_URI_FILE;
}

static int hex_digit(char character)
{
    if (character >= '0' && character <= '9')
        return character - '0';
    int letter = tolower((unsigned char)character);
    return letter >= 'a' && letter <= 'f' ? letter - 'a' + 10 : -1;
}

/* Decodes percent-encoded text. Returns the number of bytes, which is at most the length of the text. */
static size_t decode_percents(const char *text, unsigned char *ret_bytes)
{
    size_t size = 0;
    for (const char *at = text; *at; at++) {
        int high = *at == '%' ? hex_digit(at[1]) : -1, low = high < 0 ? -1 : hex_digit(at[2]);
        ret_bytes[size++] = (unsigned char)(low < 0 ? *at : high * 16 + low);
        at += low < 0 ? 0 : 2;
    }
    return size;
}

char *gltf_uri_path(const char *base, const char *uri, struct memory *memory)
{
    struct stat status;
    const char *slash = uri[0] == '/' ? NULL : strrchr(base, '/');
    size_t directory = slash ? (size_t)(slash - base) + 1 : 0;
    char *path = memory_alloc(memory, directory + strlen(uri) + 1);
    if (!path)
        return NULL;
    memcpy(path, base, directory);
    strcpy(path + directory, uri);
    if (strchr(uri, '%') && stat(path, &status) < 0)
        path[directory + decode_percents(uri, (unsigned char *)path + directory)] = '\0';
    return path;
}

static int base64_digit(char character)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *found = character ? strchr(digits, character) : NULL;
    if (character == '-' || character == '_') /* of the alphabet for URLs */
        return character == '-' ? 62 : 63;
    return found ? (int)(found - digits) : -1;
}

static bool decode_base64(const char *text, unsigned char *ret_bytes, uint64_t *ret_size)
{
    signed char values[256];
    for (int i = 0; i < 256; i++)
        values[i] = (signed char)base64_digit((char)i);
    uint64_t size = 0;
    uint32_t bits = 0;
    unsigned held = 0;
    for (; *text && *text != '='; text++) {
        int value = values[(unsigned char)*text];
        if (value < 0)
            return false;
        bits = bits << 6 | (uint32_t)value;
        held += 6;
        if (held >= 8)
            ret_bytes[size++] = (unsigned char)(bits >> (held -= 8));
    }
    *ret_size = size;
    return held < 6 && text[strspn(text, "=")] == '\0';
}

enum bvhd_status gltf_uri_decode(const char *uri, struct memory *memory, unsigned char **ret_data, uint64_t *ret_size)
{
    static const char base64[] = ";base64";
    const char *comma = strchr(uri, ',');
    if (!comma)
        return BVHD_INVALID;
    size_t length = sizeof base64 - 1;
    bool is_base64 = (size_t)(comma - uri) >= length && !memcmp(comma - length, base64, length);
    unsigned char *data = memory_alloc(memory, strlen(comma + 1) + 1);
    if (!data)
        return BVHD_NO_MEMORY;
    if (!is_base64) {
        *ret_size = decode_percents(comma + 1, data);
    } else if (!decode_base64(comma + 1, data, ret_size)) {
        memory_free(memory, data);
        return BVHD_INVALID;
    }
    *ret_data = data;
    return BVHD_OK;
}
