/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/content_key.h"

#include <openssl/err.h>
#include <openssl/evp.h>

#include "builder/build.h"
#include "builder/format/layout.h"
#include "builder/piece/embree.h"
#include "builder/tier.h"

/* The terminating NULs are hashed too, so that the bytes after them start at a fixed offset. */
static const char leaf_domain[16] = "bvhd key leaf 1", root_domain[16] = "bvhd key root 2",
                  embree_domain[16] = "bvhd key embree", update_domain[16] = "bvhd key update",
                  record_domain[16] = "bvhd key record";

struct digest_input {
    const void *data;
    size_t size;
};

static bool digest(const EVP_MD *hash, const struct digest_input *inputs, int count, struct key *ret_digest)
{
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    bool good = context && EVP_DigestInit_ex(context, hash, NULL) == 1;
    for (int i = 0; good && i < count; i++)
        good = EVP_DigestUpdate(context, inputs[i].data, inputs[i].size) == 1;
    good = good && EVP_DigestFinal_ex(context, ret_digest->bytes, NULL) == 1;
    EVP_MD_CTX_free(context);
    return good;
}

struct leaves {
    const EVP_MD *hash;
    struct bytes block;
    struct key *digests;
    atomic_bool failed;
};

static void digest_leaf(void *context, size_t index)
{
    struct leaves *leaves = context;
    size_t begin, end;
    parallel_chunk(index, CONTENT_KEY_LEAF, leaves->block.size, &begin, &end);
    unsigned char length[8];
    bytes_put64(length, end - begin);
    const struct digest_input inputs[] = {
        {leaf_domain, sizeof leaf_domain}, {length, sizeof length}, {leaves->block.data + begin, end - begin}};
    if (!digest(leaves->hash, inputs, 3, &leaves->digests[index]))
        atomic_store_explicit(&leaves->failed, true, memory_order_relaxed);
}

/* The bytes that the root of a key hashes before the digests of the leaves. */
struct root {
    const char *domain; /* 16 bytes */
    unsigned char bytes[72]; /* the fixed-size fields */
    uint32_t size; /* bytes of them */
};

/* A layout without variants does not depend on the device, so whatever the caller put there must not change the key. */
static void describe_device(const struct device_format *device, uint32_t variants, unsigned char ret_bytes[36])
{
    memset(ret_bytes, 0, 36);
    if (variants == 0)
        return;
    memcpy(ret_bytes, device->driver_uuid, 16);
    memcpy(ret_bytes + 16, device->compatibility_uuid, 16);
    bytes_put32(ret_bytes + 32, device->variant);
}

static struct root describe_root(const struct canonical *canonical, const struct build_options *options,
                                 const struct layout *layout)
{
    struct root root = {.domain = root_domain, .size = 64};
    bytes_put64(root.bytes, canonical->size);
    bytes_put32(root.bytes + 8, BUILD_VERSION);
    bytes_put32(root.bytes + 12, layout->target);
    bytes_put32(root.bytes + 16, layout_version(layout, canonical));
    bytes_put32(root.bytes + 20, options->layout_flags);
    bytes_put32(root.bytes + 24, tier_resolve(canonical, options));
    describe_device(&options->device, layout->variants, root.bytes + 28);
    return root;
}

/* Adds the builder, unless it is our own, and refuses one that cannot be used. */
static enum bvhd_status describe_builder(const struct build_options *options, struct root *root,
                                         struct bvhd_error *error)
{
    struct embree_identity embree;
    if (options->builder == BUILDER_OWN)
        return BVHD_OK;
    if (options->builder != BUILDER_EMBREE)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "build.builder", "there is no builder %d",
                              (int)options->builder);
    enum bvhd_status status = embree_identify(&embree, error);
    if (status != BVHD_OK)
        return status;
    bytes_put32(root->bytes + root->size, embree.version);
    bytes_put32(root->bytes + root->size + 4, embree.estimate);
    root->domain = embree_domain;
    root->size += 8;
    return BVHD_OK;
}

/* Call after all leaves have been hashed; there may be none. */
static enum bvhd_status digest_root(const struct leaves *leaves, uint64_t leaf_count, const struct root *root,
                                    struct key *ret_key, struct bvhd_error *error)
{
    const struct digest_input inputs[] = {{root->domain, sizeof root_domain},
                                          {root->bytes, root->size},
                                          {leaves->digests, leaf_count * sizeof *leaves->digests}};
    struct key key;
    if (atomic_load_explicit(&leaves->failed, memory_order_relaxed) || !digest(leaves->hash, inputs, 3, &key))
        return bvhd_error_no_memory(error, "key", "no memory for the hash library"); /* it needs nothing else */
    *ret_key = key;
    return BVHD_OK;
}

static enum bvhd_status digest_all(struct leaves *leaves, const struct root *root, const struct build_context *context,
                                   struct key *ret_key, struct bvhd_error *error)
{
    uint64_t count = leaves->block.size / CONTENT_KEY_LEAF + (leaves->block.size % CONTENT_KEY_LEAF != 0);
    if (count > 0) {
        leaves->digests = memory_array(context->memory, count, sizeof *leaves->digests);
        if (!leaves->digests)
            return bvhd_error_no_memory(error, "key", "no memory for %llu digests", (unsigned long long)count);
    }
    if (!parallel_for_until(context->parallel, context->cancel, count, digest_leaf, leaves))
        return bvhd_error_set(error, BVHD_CANCELLED, "key", "cancelled");
    return digest_root(leaves, count, root, ret_key, error);
}

/*
 * Fetches SHA-256. Where the library is configured without it, this is what it says; where it lacks memory, it may say
 * that, or nothing, or what has followed from it.
 */
static enum bvhd_status fetch_hash(EVP_MD **ret_hash, struct bvhd_error *error)
{
    ERR_clear_error();
    EVP_MD *hash = EVP_MD_fetch(NULL, "SHA256", NULL);
    if (hash) {
        *ret_hash = hash;
        return BVHD_OK;
    }
    bool is_missing = ERR_GET_REASON(ERR_peek_error()) == ERR_R_UNSUPPORTED;
    ERR_clear_error();
    return is_missing ? bvhd_error_set(error, BVHD_INTERNAL, "key", "the hash library has no SHA-256")
                      : bvhd_error_no_memory(error, "key", "no memory for the hash library");
}

/*
 * Hashes the canonical copy and the root. One fetch serves all leaves: it takes locks that the threads would wait for.
 */
static enum bvhd_status digest_copy(const struct canonical *canonical, const struct root *root,
                                    const struct build_context *context, struct key *ret_key, struct bvhd_error *error)
{
    EVP_MD *hash = NULL;
    enum bvhd_status status = fetch_hash(&hash, error);
    if (status != BVHD_OK)
        return status;
    struct leaves leaves = {.hash = hash, .block = {canonical->bytes, canonical->size}};
    status = digest_all(&leaves, root, context, ret_key, error);
    memory_free(context->memory, leaves.digests);
    EVP_MD_free(hash);
    return status;
}

static enum bvhd_status find_layout(const struct build_options *options, const struct layout **ret_layout,
                                    struct bvhd_error *error)
{
    *ret_layout = layout_find(options->target);
    return *ret_layout
               ? BVHD_OK
               : bvhd_error_set(error, BVHD_UNSUPPORTED, "target", "there is no target %d", (int)options->target);
}

enum bvhd_status content_key(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, struct key *ret_key, struct bvhd_error *error)
{
    const struct layout *layout;
    enum bvhd_status status = find_layout(options, &layout, error);
    if (status != BVHD_OK)
        return status;
    struct root root = describe_root(canonical, options, layout);
    status = describe_builder(options, &root, error);
    return status == BVHD_OK ? digest_copy(canonical, &root, context, ret_key, error) : status;
}

enum bvhd_status content_key_update(const struct canonical *canonical, const struct build_options *options,
                                    const struct key *source, const struct build_context *context, struct key *ret_key,
                                    struct bvhd_error *error)
{
    const struct layout *layout;
    enum bvhd_status status = find_layout(options, &layout, error);
    if (status != BVHD_OK)
        return status;
    struct root root = {.domain = update_domain, .size = 52};
    memcpy(root.bytes, source->bytes, KEY_SIZE);
    bytes_put64(root.bytes + 32, canonical->size);
    bytes_put32(root.bytes + 40, REFIT_VERSION);
    bytes_put32(root.bytes + 44, layout->target);
    bytes_put32(root.bytes + 48, layout_version(layout, canonical));
    return digest_copy(canonical, &root, context, ret_key, error);
}

enum bvhd_status content_key_of_record(const struct key *key, struct key *ret_key, struct bvhd_error *error)
{
    const struct digest_input inputs[] = {{record_domain, sizeof record_domain}, {key->bytes, sizeof key->bytes}};
    EVP_MD *hash = NULL;
    enum bvhd_status status = fetch_hash(&hash, error);
    if (status != BVHD_OK)
        return status;
    bool good = digest(hash, inputs, 2, ret_key);
    EVP_MD_free(hash);
    return good ? BVHD_OK : bvhd_error_no_memory(error, "key", "no memory for the hash library");
}
