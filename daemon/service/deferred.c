/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/deferred.h"

#include <stddef.h>

void deferred_add(struct deferred_calls *calls, struct deferred_call *call)
{
    call->next = NULL;
    call->previous = calls->last;
    if (calls->last)
        calls->last->next = call;
    else
        calls->first = call;
    calls->last = call;
}

void deferred_cancel(struct deferred_calls *calls, struct deferred_call *call)
{
    if (call->previous)
        call->previous->next = call->next;
    else
        calls->first = call->next;
    if (call->next)
        call->next->previous = call->previous;
    else
        calls->last = call->previous;
    call->previous = call->next = NULL;
}

void deferred_run(struct deferred_calls *calls)
{
    while (calls->first) {
        struct deferred_call *call = calls->first;
        deferred_cancel(calls, call);
        call->run(call);
    }
}
