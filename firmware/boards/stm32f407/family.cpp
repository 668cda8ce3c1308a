// Clocks and UART of an STM32F407. See family.hpp.
#include "family.hpp"

namespace board {

namespace {

DMA_HandleTypeDef receive_dma, transmit_dma;

static_assert(HSE_VALUE % 2'000'000 == 0 && HSE_VALUE >= 4'000'000 && HSE_VALUE <= 26'000'000,
              "CRYSTAL_HZ: an even number of megahertz, 4 to 26");

/// Start the PLL. It gets 2 MHz, for the lowest jitter; its 336 MHz make 168 MHz for the core.
bool start_pll(RCC_OscInitTypeDef source, std::uint32_t name, std::uint32_t hz) {
  source.PLL.PLLState = RCC_PLL_ON;
  source.PLL.PLLSource = name;
  source.PLL.PLLM = hz / 2'000'000;
  source.PLL.PLLN = 168;
  source.PLL.PLLP = RCC_PLLP_DIV2;
  source.PLL.PLLQ = 7;
  return HAL_RCC_OscConfig(&source) == HAL_OK;
}

bool start_dma(DMA_HandleTypeDef& dma, DMA_Stream_TypeDef* stream, std::uint32_t direction, std::uint32_t mode,
               std::uint32_t priority) {
  dma.Instance = stream;
  dma.Init.Channel = DMA_CHANNEL_4;
  dma.Init.Direction = direction;
  dma.Init.PeriphInc = DMA_PINC_DISABLE;
  dma.Init.MemInc = DMA_MINC_ENABLE;
  dma.Init.PeriphDataAlignment = DMA_PDATAALIGN_BYTE;
  dma.Init.MemDataAlignment = DMA_MDATAALIGN_BYTE;
  dma.Init.Mode = mode;
  dma.Init.Priority = priority;
  dma.Init.FIFOMode = DMA_FIFOMODE_DISABLE;
  return HAL_DMA_Init(&dma) == HAL_OK;
}

}  // namespace

bool start_clocks() {
  __HAL_RCC_PWR_CLK_ENABLE();
  __HAL_PWR_VOLTAGESCALING_CONFIG(PWR_REGULATOR_VOLTAGE_SCALE1);
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
  clocks.APB1CLKDivider = RCC_HCLK_DIV4;
  clocks.APB2CLKDivider = RCC_HCLK_DIV2;
  return HAL_RCC_ClockConfig(&clocks, FLASH_LATENCY_5) == HAL_OK;
}

bool start_family_uart(UART_HandleTypeDef& uart) {
  __HAL_RCC_DMA1_CLK_ENABLE();
  // RM0090, table 42: channel 4 of streams 1 and 3 is USART3.
  if (!start_dma(receive_dma, DMA1_Stream1, DMA_PERIPH_TO_MEMORY, DMA_CIRCULAR, DMA_PRIORITY_VERY_HIGH) ||
      !start_dma(transmit_dma, DMA1_Stream3, DMA_MEMORY_TO_PERIPH, DMA_NORMAL, DMA_PRIORITY_HIGH)) {
    return false;
  }
  __HAL_LINKDMA(&uart, hdmarx, receive_dma);
  __HAL_LINKDMA(&uart, hdmatx, transmit_dma);
  if (HAL_UART_Init(&uart) != HAL_OK) return false;
  __HAL_UART_ONE_BIT_SAMPLE_ENABLE(&uart);
  return true;
}

}  // namespace board

extern "C" void DMA1_Stream1_IRQHandler() { HAL_DMA_IRQHandler(&board::receive_dma); }
extern "C" void DMA1_Stream3_IRQHandler() { HAL_DMA_IRQHandler(&board::transmit_dma); }
