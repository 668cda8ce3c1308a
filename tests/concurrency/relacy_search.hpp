// How a scene is searched by relacy, as the command line says it. `full` tries every schedule and every value that a
// load may see in it; `whole` the same without schedules that differ in nothing but their names (see Preemption);
// `bound` every schedule with at most AMOUNT preemptions; `random` draws AMOUNT executions. A load may see one of a
// word's newest three values at most.
#pragma once

#include <cstddef>
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

struct NamedScene {
  const char* name;
  int (*explore)(const std::string& mode, unsigned amount);
};

/// The program: SCENE SITE MODE AMOUNT. `Orders::weaken(site)` weakens the memory order of this name, or none; false:
/// it has no such name. The exit code is that of `explore`, or 2 where the arguments are wrong.
template <class Orders, std::size_t Count>
int search(int argument_count, char** arguments, const NamedScene (&scenes)[Count]) {
  if (argument_count != 5) {
    std::fprintf(stderr, "usage: %s SCENE SITE full|whole|bound|random AMOUNT; the scenes are", arguments[0]);
    for (const NamedScene& scene : scenes) std::fprintf(stderr, " %s", scene.name);
    std::fprintf(stderr, "\n");
    return 2;
  }
  const std::string wanted = arguments[1];
  const std::string site = arguments[2];
  const std::string mode = arguments[3];
  if (mode != "full" && mode != "whole" && mode != "bound" && mode != "random") {
    std::fprintf(stderr, "there is no mode %s\n", mode.c_str());
    return 2;
  }
  if (!Orders::weaken(site)) {
    std::fprintf(stderr, "there is no site %s\n", site.c_str());
    return 2;
  }
  for (const NamedScene& scene : scenes) {
    if (wanted == scene.name) return scene.explore(mode, static_cast<unsigned>(std::atoi(arguments[4])));
  }
  std::fprintf(stderr, "there is no scene %s\n", wanted.c_str());
  return 2;
}
