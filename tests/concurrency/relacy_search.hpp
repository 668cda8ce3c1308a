// How a scene is searched by relacy, as the command line says it. `bound` tries every schedule with at most AMOUNT
// preemptions and every value that a load may see in it; `full` has no such bound; `random` draws AMOUNT executions.
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
  if (mode == "full") {
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
