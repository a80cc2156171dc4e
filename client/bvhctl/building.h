/* SPDX-License-Identifier: Apache-2.0 */
/*
 * building.h - what `bvhctl build` and `bvhctl update` share: a backend, an output with its manifest, and what is
 * printed about structures and failures.
 */
#ifndef BVHCTL_BUILDING_H
#define BVHCTL_BUILDING_H

#include "client/bvhctl/base/options.h"
#include "client/bvhctl/base/report.h"
#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/scene/output.h"
#include "client/bvhctl/service/backend_local.h"
#include "client/bvhctl/service/backend_service.h"

struct building_failure {
    char *what;
    struct bvhd_error error;
};

struct building {
    const char *command; /* its name, for messages */
    const struct options *options; /* points to `complete` */
    struct options complete; /* the options, with the format that they mean */
    struct bvhd_format format;
    struct memory memory; /* the budget: for scenes, and for builds in this process */
    struct memory notes; /* for messages and lists: outside the budget, so that its exhaustion can be reported */
    struct progress progress;
    struct backend *backend; /* that of `local` or of `service` */
    struct backend_local local;
    struct backend_service service;
    struct json report; /* what --json prints */
    struct output output;
    struct json manifest, manifest_scenes;
    struct building_failure *failures;
    uint32_t failure_count, failure_capacity;
    bool failed;
    struct bvhd_error loss; /* its status is not BVHD_OK if the connection to the service was lost */
    uint64_t structure_count, byte_count; /* of what was written */
    double start;
};

/* Begins a command. The struct must not be moved. End with building_finish. */
void building_init(struct building *run, const char *command, const struct options *options);

/* Finds the format of the device that structures are built for, and opens the backend that the options name. */
enum bvhd_status building_open(struct building *run, struct bvhd_error *error);

/* Prints an error at once, and keeps it for the JSON object. */
void building_fail(struct building *run, const char *what, const struct bvhd_error *error);

/* Begins the manifest of an output that is open, and ends it: then the output is complete, if nothing has failed. */
void building_begin_manifest(struct building *run);
enum bvhd_status building_end_manifest(struct building *run, struct bvhd_error *error);

/*
 * Writes all structures of a scene, with their entries in the manifest, as that of the scene, and in the report, whose
 * array "structures" is open. One that cannot be written has failed, like one that cannot be built.
 */
void building_keep(struct building *run, struct assembly *assembly, const struct file_names *names);

/* Returns whether results are printed for people. */
bool building_prints_text(const struct building *run);

/* Writes the member "errors" of the report. */
void building_write_errors(struct building *run);

void building_finish(struct building *run);

#endif
