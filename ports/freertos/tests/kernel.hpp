// The double's kernel: the context that runs, the time, and when a task would wait.
#pragma once

#include "task.h"

namespace kernel {

/// Back to the beginning: no interrupt, tick 0.
void reset();
/// Let the task run until it waits for a notification longer than `ticks` in all.
void run_task(StaticTask_t& task, TickType_t ticks);
/// The task that was created last.
StaticTask_t& last_created();
void set_interrupt(bool inside);
void set_ticks(TickType_t ticks);
/// Changes of task that an interrupt asked for.
int yields();

}  // namespace kernel
