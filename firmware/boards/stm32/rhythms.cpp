// See rhythms.hpp. The family has the timers, and the handlers that call `on_rhythm`.
#include "rhythms.hpp"

#include <array>

#include "board.hpp"

namespace board {

namespace {

std::array<TIM_HandleTypeDef, rhythms> timers;
void (*run_rhythm)(std::size_t) = nullptr;

}  // namespace

void start_rhythms(void (*run)(std::size_t rhythm), std::uint32_t period_us) {
  constexpr std::uint32_t apart_us = 5;
  run_rhythm = run;
  for (std::size_t i = 0; i < rhythms; ++i) {
    TIM_HandleTypeDef& timer = timers[i];
    const RhythmTimer& name = rhythm_timers[i];
    name.enable_clock();
    timer.Instance = name.timer;
    timer.Init.Prescaler = name.timer_hz / 1'000'000 - 1;
    timer.Init.Period = period_us - 1;
    if (HAL_TIM_Base_Init(&timer) != HAL_OK) fail();
    __HAL_TIM_CLEAR_FLAG(&timer, TIM_FLAG_UPDATE);  // raised by the HAL's initialisation
    HAL_NVIC_SetPriority(name.interrupt, rhythm_priority(i), 0);
    HAL_NVIC_EnableIRQ(name.interrupt);
  }
  __disable_irq();  // otherwise the first would delay the start of the others
  for (std::size_t i = 0; i < rhythms; ++i) {
    __HAL_TIM_SET_COUNTER(&timers[i], static_cast<std::uint32_t>(rhythms - 1 - i) * apart_us);
    if (HAL_TIM_Base_Start_IT(&timers[i]) != HAL_OK) fail();
  }
  __enable_irq();
}

void on_rhythm(std::size_t rhythm) {
  __HAL_TIM_CLEAR_FLAG(&timers[rhythm], TIM_FLAG_UPDATE);
  run_rhythm(rhythm);
}

}  // namespace board
