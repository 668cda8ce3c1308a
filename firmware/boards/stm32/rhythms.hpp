// Four timers, each with an interrupt of its own priority: they replace four tasks of an RTOS.
#pragma once

#include <cstddef>
#include <cstdint>

#include "family.hpp"

namespace board {

constexpr std::size_t rhythms = 4;

/// Return the priority of a rhythm, from the least urgent one, 0, to the most urgent. All are less urgent than the
/// UART's interrupt, which a sender pends: so its frame begins to leave before the sender returns.
constexpr std::uint32_t rhythm_priority(std::size_t rhythm) { return 5 - static_cast<std::uint32_t>(rhythm); }

/// Call `run` for each rhythm every `period_us`. They begin 5 us apart, the least urgent first: so each is interrupted
/// by the next in the middle of its work, as tasks are.
void start_rhythms(void (*run)(std::size_t rhythm), std::uint32_t period_us);

/// Called by the timers' handlers.
void on_rhythm(std::size_t rhythm);

}  // namespace board
