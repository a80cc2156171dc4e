/* SPDX-License-Identifier: Apache-2.0 */
/*
 * interrupts.c - `interrupts SIGNAL MILLISECONDS COMMAND...` runs a command, waits until it handles the signal (INT or
 * TERM) and that time more, sends it, and prints how the command ended: "signal 2", "exit 0". A shell cannot tell a
 * process that a signal has ended from one that exits with 128 and more.
 */
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { PATIENCE_MS = 60000 };

static void nap(long ms)
{
    nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL);
}

/* Returns whether the process has a handler for the signal, or has ended. */
static bool handles(pid_t process, int number)
{
    char path[64], line[256];
    unsigned long long caught = 0;
    bool is_there = false;
    snprintf(path, sizeof path, "/proc/%d/status", (int)process);
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file))
        is_there |= sscanf(line, "SigCgt: %llx", &caught) == 1;
    if (file)
        fclose(file);
    return !is_there || caught >> (number - 1) & 1;
}

int main(int argc, char **argv)
{
    if (argc < 4)
        return 2;
    int number = strcmp(argv[1], "INT") ? SIGTERM : SIGINT, status;
    long ms = atol(argv[2]);
    pid_t child = fork();
    if (child == 0) {
        signal(number, SIG_DFL); /* a shell makes its background processes ignore interrupts */
        execv(argv[3], argv + 3);
        _exit(127);
    }
    if (child < 0)
        return 1;
    for (int waited = 0; waited < PATIENCE_MS && !handles(child, number); waited++)
        nap(1);
    nap(ms);
    kill(child, number);
    if (waitpid(child, &status, 0) != child)
        return 1;
    if (WIFSIGNALED(status))
        printf("signal %d\n", WTERMSIG(status));
    else
        printf("exit %d\n", WEXITSTATUS(status));
    return 0;
}
