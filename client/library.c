/* SPDX-License-Identifier: Apache-2.0 */
#include "client/library.h"

#include <limits.h>

#include <bvhd/bvhd.h>

#include "proto/base/key.h"
#include "proto/base/status.h"

_Static_assert((int)BVHD_KEY_SIZE == (int)KEY_SIZE && (int)BVHD_KEY_TEXT_SIZE == (int)KEY_TEXT_SIZE, "one kind of key");

struct memory library_memory = {.limit = UINT64_MAX, .fail_after = -1};

uint64_t library_after(uint64_t now, int64_t ms)
{
    return ms < 0 ? LIBRARY_NEVER : now + (uint64_t)ms * LIBRARY_MS;
}

int library_poll_ms(uint64_t now, uint64_t moment)
{
    if (moment == LIBRARY_NEVER)
        return -1;
    if (moment <= now)
        return 0;
    uint64_t ms = (moment - now + LIBRARY_MS - 1) / LIBRARY_MS;
    return ms > INT_MAX ? INT_MAX : (int)ms;
}

const char *bvhd_version(void)
{
    return BVHD_VERSION_STRING;
}

void bvhd_key_to_text(const struct bvhd_key *key, char ret_text[BVHD_KEY_TEXT_SIZE])
{
    struct key copy;
    if (ret_text)
        ret_text[0] = '\0';
    if (!ret_text || !key)
        return;
    memcpy(copy.bytes, key->bytes, sizeof copy.bytes);
    key_to_text(&copy, ret_text);
}

enum bvhd_status bvhd_key_from_text(const char *text, struct bvhd_key *ret_key)
{
    struct key key;
    if (!text || !ret_key || key_from_text(text, &key) != 0)
        return BVHD_INVALID;
    memcpy(ret_key->bytes, key.bytes, sizeof key.bytes);
    return BVHD_OK;
}
