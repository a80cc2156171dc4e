/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/options_table.h"

static void print_option(const struct option_row *row)
{
    char name[64];
    snprintf(name, sizeof name, "%s--%s%s%s",
             row->value == 'o'   ? "-o, "
             : row->value == 'h' ? "-h, "
                                 : "    ",
             row->name, row->argument ? " " : "", row->argument ? row->argument : "");
    const char *text = row->help;
    for (const char *label = name; text; label = "") {
        size_t length = strcspn(text, "\n");
        printf("  %-26s  %.*s\n", label, (int)length, text);
        text = text[length] ? text + length + 1 : NULL;
    }
}

static void print_options(unsigned commands)
{
    printf("\nOptions:\n");
    for (const struct option_row *row = option_rows; row->name; row++)
        if (row->commands & commands)
            print_option(row);
}

void options_print_help(enum command about)
{
    if (about < COMMAND_COUNT) {
        const struct command_row *row = &command_rows[about];
        printf("Usage: bvhctl [--socket PATH%s] %s%s%s [OPTION...]\n\nWhat it does: %s.\n",
               1u << about & ON_SCENES ? " | --local" : "", row->name, *row->arguments ? " " : "", row->arguments,
               row->purpose);
        print_options(1u << about);
        return;
    }
    printf("Usage: bvhctl [--socket PATH | --local] COMMAND ...\n\n"
           "Builds Vulkan acceleration structures on the CPU, and inspects the results.\n\nCommands:\n");
    for (int i = 0; i < COMMAND_COUNT; i++)
        printf("  %-8s %-23s  %s\n", command_rows[i].name, command_rows[i].arguments, command_rows[i].purpose);
    print_options(ON_MAIN);
    printf("\nbvhctl COMMAND --help says more about a command.\n"
           "Exit status: 0 done, 1 failed, 2 wrong usage, 3 something wrong was found, 4 no daemon.\n");
}
