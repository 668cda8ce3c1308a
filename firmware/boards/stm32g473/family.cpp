// Clocks and UART of an STM32G473. See family.hpp.
#include "family.hpp"

namespace board {

namespace {

DMA_HandleTypeDef receive_dma, transmit_dma;

static_assert(HSE_VALUE % 4'000'000 == 0 && HSE_VALUE >= 4'000'000 && HSE_VALUE <= 48'000'000,
              "CRYSTAL_HZ: a multiple of 4 MHz, up to 48 MHz");

/// Start the PLL. It gets 4 MHz; its 340 MHz make 170 MHz for the core.
bool start_pll(RCC_OscInitTypeDef source, std::uint32_t name, std::uint32_t hz) {
  source.PLL.PLLState = RCC_PLL_ON;
  source.PLL.PLLSource = name;
  source.PLL.PLLM = hz / 4'000'000;  // the HAL's names for these numbers are the numbers
  source.PLL.PLLN = 85;
  source.PLL.PLLP = RCC_PLLP_DIV2;
  source.PLL.PLLQ = RCC_PLLQ_DIV2;
  source.PLL.PLLR = RCC_PLLR_DIV2;
  return HAL_RCC_OscConfig(&source) == HAL_OK;
}
static_assert(RCC_PLLM_DIV1 == 1 && RCC_PLLM_DIV12 == 12, "the HAL names PLLM's divisors otherwise");

bool start_dma(DMA_HandleTypeDef& dma, DMA_Channel_TypeDef* channel, std::uint32_t request, std::uint32_t direction,
               std::uint32_t mode, std::uint32_t priority) {
  dma.Instance = channel;
  dma.Init.Request = request;
  dma.Init.Direction = direction;
  dma.Init.PeriphInc = DMA_PINC_DISABLE;
  dma.Init.MemInc = DMA_MINC_ENABLE;
  dma.Init.PeriphDataAlignment = DMA_PDATAALIGN_BYTE;
  dma.Init.MemDataAlignment = DMA_MDATAALIGN_BYTE;
  dma.Init.Mode = mode;
  dma.Init.Priority = priority;
  return HAL_DMA_Init(&dma) == HAL_OK;
}

}  // namespace

bool start_clocks() {
  __HAL_RCC_PWR_CLK_ENABLE();
  __HAL_RCC_SYSCFG_CLK_ENABLE();
  if (HAL_PWREx_ControlVoltageScaling(PWR_REGULATOR_VOLTAGE_SCALE1_BOOST) != HAL_OK) return false;
  RCC_OscInitTypeDef crystal{};
  crystal.OscillatorType = RCC_OSCILLATORTYPE_HSE;
  crystal.HSEState = RCC_HSE_ON;
  RCC_OscInitTypeDef internal{};
  internal.OscillatorType = RCC_OSCILLATORTYPE_HSI;
  internal.HSIState = RCC_HSI_ON;
  internal.HSICalibrationValue = RCC_HSICALIBRATION_DEFAULT;
  if (!start_pll(crystal, RCC_PLLSOURCE_HSE, HSE_VALUE) && !start_pll(internal, RCC_PLLSOURCE_HSI, HSI_VALUE)) {
    return false;
  }
  RCC_ClkInitTypeDef clocks{};
  clocks.ClockType = RCC_CLOCKTYPE_SYSCLK | RCC_CLOCKTYPE_HCLK | RCC_CLOCKTYPE_PCLK1 | RCC_CLOCKTYPE_PCLK2;
  clocks.SYSCLKSource = RCC_SYSCLKSOURCE_PLLCLK;
  clocks.AHBCLKDivider = RCC_SYSCLK_DIV1;
  clocks.APB1CLKDivider = RCC_HCLK_DIV1;
  clocks.APB2CLKDivider = RCC_HCLK_DIV1;
  return HAL_RCC_ClockConfig(&clocks, FLASH_LATENCY_4) == HAL_OK;
}

bool start_family_uart(UART_HandleTypeDef& uart) {
  __HAL_RCC_DMAMUX1_CLK_ENABLE();
  __HAL_RCC_DMA1_CLK_ENABLE();
  if (!start_dma(receive_dma, DMA1_Channel1, DMA_REQUEST_USART3_RX, DMA_PERIPH_TO_MEMORY, DMA_CIRCULAR,
                 DMA_PRIORITY_VERY_HIGH) ||
      !start_dma(transmit_dma, DMA1_Channel7, DMA_REQUEST_USART3_TX, DMA_MEMORY_TO_PERIPH, DMA_NORMAL,
                 DMA_PRIORITY_HIGH)) {
    return false;
  }
  __HAL_LINKDMA(&uart, hdmarx, receive_dma);
  __HAL_LINKDMA(&uart, hdmatx, transmit_dma);
  uart.Init.OneBitSampling = UART_ONE_BIT_SAMPLE_ENABLE;
  uart.Init.ClockPrescaler = UART_PRESCALER_DIV1;
  return HAL_UART_Init(&uart) == HAL_OK;
}

}  // namespace board

extern "C" void DMA1_Channel1_IRQHandler() { HAL_DMA_IRQHandler(&board::receive_dma); }
extern "C" void DMA1_Channel7_IRQHandler() { HAL_DMA_IRQHandler(&board::transmit_dma); }
