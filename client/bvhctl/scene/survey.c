/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/survey.h"

#include <string.h>

#include "client/bvhctl/scene/target_reader.h"

const char *survey_content_name(const struct structure *structure)
{
    return target_reader_find(structure->target)->content_name(structure);
}

void survey_add_figure(struct survey *survey, const char *name, uint64_t value)
{
    survey->figures[survey->figure_count++] = (struct survey_figure){name, value};
}

const uint64_t *survey_find_figure(const struct survey *survey, const char *name)
{
    for (uint32_t i = 0; i < survey->figure_count; i++)
        if (!strcmp(survey->figures[i].name, name))
            return &survey->figures[i].value;
    return NULL;
}

enum bvhd_status survey_take(const struct structure *structure, struct memory *memory, struct survey *ret_survey,
                             struct bvhd_error *error)
{
    struct survey survey = {0};
    enum bvhd_status status = target_reader_find(structure->target)->survey(structure, memory, &survey);
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, "nodes", "no memory to walk them");
    *ret_survey = survey;
    return BVHD_OK;
}
