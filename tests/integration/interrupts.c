/* SPDX-License-Identifier: Apache-2.0 */
/*
 * interrupts.c - `interrupts SIGNAL MILLISECONDS COMMAND...` runs a command, sends it the signal (INT or TERM) after
 * that time, and prints how it ended: "signal 2", "exit 0". A shell cannot tell a process that a signal has ended from
 * one that exits with 128 and more.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

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
    nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL);
    kill(child, number);
    if (waitpid(child, &status, 0) != child)
        return 1;
    if (WIFSIGNALED(status))
        printf("signal %d\n", WTERMSIG(status));
    else
        printf("exit %d\n", WEXITSTATUS(status));
    return 0;
}
