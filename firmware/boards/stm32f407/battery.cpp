// ADC1 of an STM32F407, whose input 10 is PC0. See battery.hpp.
#include "battery.hpp"

#include "board.hpp"
#include "pin.hpp"

namespace board {

namespace {

ADC_HandleTypeDef adc;

}  // namespace

void start_battery() {
  __HAL_RCC_ADC1_CLK_ENABLE();
  configure({GPIOC, GPIO_PIN_0}, GPIO_MODE_ANALOG, GPIO_NOPULL);
  adc.Instance = ADC1;
  adc.Init.ClockPrescaler = ADC_CLOCK_SYNC_PCLK_DIV4;
  adc.Init.Resolution = ADC_RESOLUTION_12B;
  adc.Init.DataAlign = ADC_DATAALIGN_RIGHT;
  adc.Init.EOCSelection = ADC_EOC_SINGLE_CONV;
  adc.Init.ExternalTrigConv = ADC_SOFTWARE_START;
  adc.Init.ExternalTrigConvEdge = ADC_EXTERNALTRIGCONVEDGE_NONE;
  adc.Init.NbrOfConversion = 1;
  ADC_ChannelConfTypeDef channel{};
  channel.Channel = ADC_CHANNEL_10;
  channel.Rank = 1;
  channel.SamplingTime = ADC_SAMPLETIME_84CYCLES;
  if (HAL_ADC_Init(&adc) != HAL_OK || HAL_ADC_ConfigChannel(&adc, &channel) != HAL_OK) fail();
}

float battery_pin_v() {
  constexpr std::uint32_t timeout_ms = 2;
  if (HAL_ADC_Start(&adc) != HAL_OK || HAL_ADC_PollForConversion(&adc, timeout_ms) != HAL_OK) return 0.0F;
  return static_cast<float>(HAL_ADC_GetValue(&adc)) * (3.3F / 4095.0F);
}

}  // namespace board
