// The handlers of the timers in family.hpp.
#include "rhythms.hpp"

extern "C" void TIM6_DAC_IRQHandler() { board::on_rhythm(0); }
extern "C" void TIM7_DAC_IRQHandler() { board::on_rhythm(1); }
extern "C" void TIM1_UP_TIM16_IRQHandler() { board::on_rhythm(2); }
extern "C" void TIM1_TRG_COM_TIM17_IRQHandler() { board::on_rhythm(3); }
