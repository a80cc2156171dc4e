/* SPDX-License-Identifier: Apache-2.0 */
/* Takes the place of embree.c in a build without Embree's headers. */
#include "builder/piece/embree.h"

static enum bvhd_status refuse(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_UNSUPPORTED, "build.builder", "this bvhd was built without Embree");
}

enum bvhd_status embree_identify(struct embree_identity *ret_identity, struct bvhd_error *error)
{
    (void)ret_identity;
    return refuse(error);
}

enum bvhd_status embree_open(struct bvhd_error *error)
{
    return refuse(error);
}

void embree_close(void)
{
}

enum bvhd_status embree_build(const struct embree_request *request, struct memory *memory, struct ir *ret_ir,
                              struct bvhd_error *error)
{
    (void)request;
    (void)memory;
    (void)ret_ir;
    return refuse(error);
}
