// How a scene is searched by relacy, as the command line says it. `full` tries every schedule and every value that a
// load may see in it; `whole` the same without schedules that differ in nothing but their names (see Preemption);
// `bound` every schedule with at most AMOUNT preemptions; `random` draws AMOUNT executions. A load may see one of a
// word's newest three values at most.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>

#include "relacy_policy.hpp"

/// The exit code: 0, no fault; 1, a fault. Prints how many executions were tried, and with RELACY_REPORT in the
/// environment the faulty execution as well.
template <class Scene>
int explore(const std::string& mode, unsigned amount) {
  // Not a string stream: while a test runs, memory is relacy's.
  std::ostream silent(nullptr);
  const bool reports = std::getenv("RELACY_REPORT") != nullptr;
  rl::test_params params;
  params.output_stream = reports ? &std::cout : &silent;
  params.progress_stream = &silent;
  params.execution_depth_limit = 4000;
  Preemption::before_stores = mode != "whole";
  if (mode == "full" || mode == "whole") {
    params.search_type = rl::fair_full_search_scheduler_type;
  } else if (mode == "bound") {
    params.search_type = rl::fair_context_bound_scheduler_type;
    params.context_bound = amount;
  } else {
    params.search_type = rl::random_scheduler_type;
    params.iteration_count = amount;
  }
  const bool held = rl::simulate<Scene>(params);
  std::printf("%s after %llu executions\n", held ? "no fault" : rl::test_result_str(params.test_result),
              static_cast<unsigned long long>(params.stop_iteration));
  return held ? 0 : 1;
}
