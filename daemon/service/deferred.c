/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/deferred.h"

#include "proto/base/container_of.h"

void deferred_add(struct deferred_calls *calls, struct deferred_call *call)
{
    list_append(&calls->list, &call->link);
}

void deferred_cancel(struct deferred_calls *calls, struct deferred_call *call)
{
    list_remove(&calls->list, &call->link);
}

void deferred_run(struct deferred_calls *calls)
{
    struct list_link *link;
    while ((link = list_take_first(&calls->list))) {
        struct deferred_call *call = container_of(link, struct deferred_call, link);
        call->run(call);
    }
}
