/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/completion.h"

#include <stdio.h>
#include <string.h>

static const char scene_endings[] = "*.gltf *.glb *.ply *.obj *.stl *.fbx *.dae *.3ds *.blend *.off *.x3d *.usd *.3mf";
static const char built_endings[] = "*.bvhd";

/* The values of options. Rows with a command are for that command alone, and come first. */
static const struct {
    int value;
    unsigned commands;
    struct completion_row row;
} values[] = {
    {'o', ON_BUILD, {COMPLETION_FILE, NULL, built_endings}},
    {'o', ON_UPDATE, {COMPLETION_FILE, NULL, built_endings}},
    {'o', ON_TRACE, {COMPLETION_FILE, NULL, "*.png"}},
    {'o', ON_GET, {COMPLETION_FILE, NULL, "*.as"}},
    {'o', ON_PROBE, {COMPLETION_FILE, NULL, "*.probe"}},
    {OPTION_DEPFILE, ~0u, {COMPLETION_FILE, NULL, "*.d"}},
    {OPTION_TARGET, ~0u, {COMPLETION_NAME, target_names, NULL}},
    {OPTION_PROBE, ~0u, {COMPLETION_FILE, NULL, "*.probe"}},
    {OPTION_QUALITY, ~0u, {COMPLETION_NAME, quality_names, NULL}},
    {OPTION_BUILDER, ~0u, {COMPLETION_NAME, builder_names, NULL}},
    {OPTION_FLAGS, ~0u, {COMPLETION_LIST, build_flag_names, NULL}},
    {OPTION_LAYOUT, ~0u, {COMPLETION_LIST, layout_flag_names, NULL}},
    {OPTION_GEOMETRY_FLAGS, ~0u, {COMPLETION_LIST, geometry_flag_names, NULL}},
    {OPTION_UP, ~0u, {COMPLETION_NAME, axis_names, NULL}},
    {OPTION_DEVICE, ON_TRACE, {COMPLETION_DEVICE, device_names, NULL}},
    {OPTION_DEVICE, ON_PROBE, {COMPLETION_DEVICE, device_names + 1, NULL}},
    {OPTION_SOCKET, ~0u, {COMPLETION_FILE, NULL, ""}},
    {OPTION_CONNECT_TIMEOUT, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_COUNT, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_INTERVAL, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_DEADLINE, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_RAYS, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_TIME, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_SEED, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_SCENE, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_AT, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_SHUTTER, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_POINTS, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_LINES, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_FRAMES, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_DECAY, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_ANIMATION, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_SIZE, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_EYE, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_LOOK_AT, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_FOV, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_TURN, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_SAMPLES, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_TIMES, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_THREADS, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_CACHE, ~0u, {COMPLETION_FILE, NULL, ""}},
    {OPTION_DISK_CACHE_SIZE, ~0u, {COMPLETION_TEXT, NULL, NULL}},
    {OPTION_MEMORY, ~0u, {COMPLETION_TEXT, NULL, NULL}},
};

/* The endings of a command's first operand, and of those that follow, or the names of the only one. */
static const struct {
    const char *first, *others; /* NULL: no files are offered */
    const struct name_value *names; /* NULL: none are offered */
} operands[COMMAND_COUNT] = {
    [COMMAND_BUILD] = {scene_endings, scene_endings, NULL},
    [COMMAND_CHECK] = {built_endings, scene_endings, NULL},
    [COMMAND_UPDATE] = {built_endings, scene_endings, NULL},
    [COMMAND_INSPECT] = {"*.as *.bvhd *.probe", NULL, NULL},
    [COMMAND_TRACE] = {built_endings, scene_endings, NULL},
    [COMMAND_COPY] = {"*.as", "*.as", NULL},
    [COMMAND_QUERY] = {"*.as", NULL, NULL},
    [COMMAND_CACHE] = {NULL, NULL, cache_action_names},
};

const struct completion_row *completion_of(const struct option_row *option)
{
    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        if (values[i].value == option->value && values[i].commands & option->commands)
            return &values[i].row;
    return NULL;
}

/* The meaning of the words before the last one. */
struct line {
    unsigned command; /* ON_ */
    const struct option_row *option; /* whose value comes next; NULL: none */
    int operands;
    bool are_options_over; /* after "--" */
};

static const struct option_row *find_option(unsigned command, const char *word, size_t length)
{
    for (const struct option_row *row = option_rows; row->name; row++) {
        bool is_letter = length == 2 && row->value == word[1];
        bool is_name =
            length > 2 && word[1] == '-' && strlen(row->name) == length - 2 && !memcmp(row->name, word + 2, length - 2);
        if (row->commands & command && (is_letter || is_name))
            return row;
    }
    return NULL;
}

static unsigned find_command(const char *word)
{
    for (int i = 0; i < COMMAND_COUNT; i++)
        if (!strcmp(command_rows[i].name, word))
            return 1u << i;
    return 0;
}

/* Shells may split "--option=value" into three words. */
static void read_word(struct line *line, const char *word)
{
    bool is_value = line->option && strcmp(word, "=") != 0;
    if (line->option) {
        line->option = is_value ? NULL : line->option;
    } else if (!line->are_options_over && !strcmp(word, "--")) {
        line->are_options_over = true;
    } else if (!line->are_options_over && word[0] == '-' && word[1]) {
        const struct option_row *option = find_option(line->command, word, strlen(word));
        line->option = option && option->argument ? option : NULL;
    } else if (line->command == ON_MAIN) {
        line->command = find_command(word);
    } else {
        line->operands++;
    }
}

static struct line read_line(int count, char *const *words)
{
    struct line line = {.command = ON_MAIN};
    for (int i = 0; i < count - 1; i++)
        read_word(&line, words[i]);
    return line;
}

/* Returns where the value begins in the word: behind "--option=", and behind the last comma of a list. */
static size_t value_start(const struct option_row *option, const char *word)
{
    const char *equals = strchr(word, '=');
    size_t start = word[0] == '-' && equals ? (size_t)(equals - word) + 1 : !strcmp(word, "=") ? 1 : 0;
    const char *comma = strrchr(word, ',');
    return completion_of(option)->kind == COMPLETION_LIST && comma ? (size_t)(comma - word) + 1 : start;
}

/* Returns the option of which the last word is the value, or NULL. */
static const struct option_row *open_option(const struct line *line, const char *word)
{
    const char *equals = strchr(word, '=');
    if (line->option || line->are_options_over || strncmp(word, "--", 2) != 0 || !equals)
        return line->option;
    const struct option_row *option = find_option(line->command, word, (size_t)(equals - word));
    return option && option->argument ? option : NULL;
}

/* A candidate keeps what the word has before `start`, unless that is "=" alone, which is a word of its own then. */
static void offer(const char *word, size_t start, const char *name, const char *description)
{
    if (strncmp(word + start, name, strlen(word + start)) != 0)
        return;
    int kept = strcmp(word, "=") ? (int)start : 0;
    printf("%.*s%s\t%s\n", kept, word, name, description);
}

static void offer_options(const struct line *line, const char *word)
{
    char name[64];
    for (const struct option_row *row = option_rows; row->name; row++)
        if (row->commands & line->command) {
            snprintf(name, sizeof name, "--%s", row->name);
            offer(word, 0, name, row->help);
        }
}

static void offer_operands(const struct line *line, const char *word)
{
    for (int i = 0; i < COMMAND_COUNT; i++) {
        bool is_more = line->operands < command_rows[i].most;
        const char *endings = line->operands == 0 ? operands[i].first : operands[i].others;
        if (line->command == ON_MAIN)
            offer(word, 0, command_rows[i].name, command_rows[i].purpose);
        else if (line->command == 1u << i && endings && is_more)
            printf(":files %s\n", endings);
        bool takes_name = line->command == 1u << i && is_more;
        for (const struct name_value *name = operands[i].names; takes_name && name && name->name; name++)
            offer(word, 0, name->name, "");
    }
}

bool completion_print(int count, char *const *words)
{
    if (count < 1)
        return false;
    const char *word = words[count - 1];
    struct line line = read_line(count, words);
    const struct option_row *option = open_option(&line, word);
    const struct completion_row *row = option ? completion_of(option) : NULL;
    if (!option && word[0] == '-' && !line.are_options_over)
        offer_options(&line, word);
    else if (!option)
        offer_operands(&line, word);
    else if (row && row->kind == COMPLETION_FILE)
        printf(":files %s\n", row->endings);
    for (const struct name_value *name = row ? row->names : NULL; name && name->name; name++)
        offer(word, value_start(option, word), name->name, "");
    return row && row->kind == COMPLETION_DEVICE;
}

void completion_offer(int count, char *const *words, const char *candidate, const char *description)
{
    const char *word = words[count - 1];
    struct line line = read_line(count, words);
    const struct option_row *option = open_option(&line, word);
    offer(word, option ? value_start(option, word) : 0, candidate, description);
}
