/* SPDX-License-Identifier: Apache-2.0 */
#include "client/format.h"

#include <string.h>

#include "client/argument.h"
#include "client/library.h"
#include "builder/format/probe.h"

enum bvhd_status bvhd_format_from_probe(const void *probe, uint64_t size, struct bvhd_format *ret_format,
                                        struct bvhd_error *ret_error)
{
    struct probe contents;
    enum target target;
    struct device_format device;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {probe, "probe"}, {ret_format, "ret_format"});
    if (status == BVHD_OK)
        status = probe_unpack((struct bytes){probe, size}, &contents, ret_error);
    if (status == BVHD_OK)
        status = probe_match(&contents, &library_memory, &target, &device, ret_error);
    if (status != BVHD_OK)
        return status;
    struct bvhd_format format = {
        .struct_size = sizeof format, .target = (enum bvhd_target)target, .variant = device.variant};
    memcpy(format.driver_uuid, device.driver_uuid, sizeof format.driver_uuid);
    memcpy(format.compatibility_uuid, device.compatibility_uuid, sizeof format.compatibility_uuid);
    *ret_format = format;
    return BVHD_OK;
}
