/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/options_table.h"

enum { COLUMNS = 80, OPTION_WIDTH = 30, COMMAND_WIDTH = 37 };

/* Prints a text from column `indent` on, in lines of at most 80 columns. The cursor is in that column already. */
static void print_wrapped(const char *text, int indent)
{
    int column = indent;
    while (*text) {
        int length = (int)strcspn(text, " ");
        if (column > indent && column + 1 + length > COLUMNS) {
            printf("\n%*s", indent, "");
            column = indent;
        }
        column += printf("%s%.*s", column > indent ? " " : "", length, text);
        text += length;
        text += strspn(text, " ");
    }
    printf("\n");
}

static void print_option(const struct option_row *row)
{
    char name[64], letter[8] = "    ";
    if (row->value < 128)
        snprintf(letter, sizeof letter, "-%c, ", row->value);
    snprintf(name, sizeof name, "  %s--%s%s%s", letter, row->name, row->argument ? " " : "",
             row->argument ? row->argument : "");
    printf("%-*s  ", OPTION_WIDTH, name);
    print_wrapped(row->help, OPTION_WIDTH + 2);
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
        printf("Usage: bvhctl %s%s%s [OPTION...]\n\nWhat it does: %s.\n", row->name, *row->arguments ? " " : "",
               row->arguments, row->purpose);
        print_options(1u << about);
        return;
    }
    printf("Usage: bvhctl [--socket PATH | --local] COMMAND ...\n\n"
           "Builds Vulkan acceleration structures on the CPU, and inspects the results.\n\nCommands:\n");
    for (int i = 0; i < COMMAND_COUNT; i++) {
        char name[64];
        snprintf(name, sizeof name, "  %s %s", command_rows[i].name, command_rows[i].arguments);
        printf("%-*s  ", COMMAND_WIDTH, name);
        print_wrapped(command_rows[i].purpose, COMMAND_WIDTH + 2);
    }
    print_options(ON_MAIN);
    printf("\nbvhctl COMMAND --help says more about a command.\n"
           "Exit status: 0 done, 1 failed, 2 wrong usage, 3 something wrong was found,\n"
           "4 no daemon.\n");
}
