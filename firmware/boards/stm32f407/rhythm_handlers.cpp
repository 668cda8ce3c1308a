// The handlers of the timers in family.hpp.
#include "rhythms.hpp"

extern "C" void TIM6_DAC_IRQHandler() { board::on_rhythm(0); }
extern "C" void TIM7_IRQHandler() { board::on_rhythm(1); }
extern "C" void TIM8_UP_TIM13_IRQHandler() { board::on_rhythm(2); }
extern "C" void TIM8_TRG_COM_TIM14_IRQHandler() { board::on_rhythm(3); }
