/* SPDX-License-Identifier: Apache-2.0 */
/* options_view.h - parses the options of `bvhctl trace` about the camera and its shutter. */
#ifndef BVHCTL_OPTIONS_VIEW_H
#define BVHCTL_OPTIONS_VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/status.h"

struct view_options {
    bool has_eye, has_look_at;
    double eye[3], look_at[3]; /* finite */
    double fov; /* vertical angle of view in degrees; 0: not given */
    uint32_t turn; /* the number of pictures from all around; 0: one picture */
    uint32_t samples; /* of each pixel; 0: not given */
    bool has_times;
    float times[2]; /* of rays: the first and the last, in 0 .. 1 */
};

/* Each takes the value of one option. BVHD_INVALID with the option in `where`. */
enum bvhd_status options_view_eye(const char *text, struct view_options *view, struct bvhd_error *error);
enum bvhd_status options_view_look_at(const char *text, struct view_options *view, struct bvhd_error *error);
enum bvhd_status options_view_fov(const char *text, struct view_options *view, struct bvhd_error *error);
enum bvhd_status options_view_turn(const char *text, struct view_options *view, struct bvhd_error *error);
enum bvhd_status options_view_samples(const char *text, struct view_options *view, struct bvhd_error *error);
enum bvhd_status options_view_times(const char *text, struct view_options *view, struct bvhd_error *error);

#endif
