/* The HAL's settings on the STM32G473: the modules that the firmwares use, no register callbacks. */
#ifndef STM32G4XX_HAL_CONF_H
#define STM32G4XX_HAL_CONF_H

#define HAL_MODULE_ENABLED
#define HAL_ADC_MODULE_ENABLED
#define HAL_CORTEX_MODULE_ENABLED
#define HAL_DMA_MODULE_ENABLED
#define HAL_FLASH_MODULE_ENABLED
#define HAL_GPIO_MODULE_ENABLED
#define HAL_I2C_MODULE_ENABLED
#define HAL_PWR_MODULE_ENABLED
#define HAL_RCC_MODULE_ENABLED
#define HAL_TIM_MODULE_ENABLED
#define HAL_UART_MODULE_ENABLED

/* HSE_VALUE, the crystal, is the build's CRYSTAL_HZ. */
#define HSE_STARTUP_TIMEOUT 100U /* ms */
#define HSI_VALUE 16000000U
#define LSE_VALUE 32768U
#define LSE_STARTUP_TIMEOUT 5000U /* ms */
#define LSI_VALUE 32000U
#define HSI48_VALUE 48000000U
#define EXTERNAL_CLOCK_VALUE 12288000U

#define VDD_VALUE 3300U      /* mV */
#define TICK_INT_PRIORITY 0U /* see board.hpp */
#define USE_RTOS 0U
#define PREFETCH_ENABLE 1U
#define INSTRUCTION_CACHE_ENABLE 1U
#define DATA_CACHE_ENABLE 1U

#define USE_HAL_ADC_REGISTER_CALLBACKS 0U
#define USE_HAL_I2C_REGISTER_CALLBACKS 0U
#define USE_HAL_TIM_REGISTER_CALLBACKS 0U
#define USE_HAL_UART_REGISTER_CALLBACKS 0U

/* Each needs some of those before it. */
/* clang-format off */
#include "stm32g4xx_hal_rcc.h"
#include "stm32g4xx_hal_gpio.h"
#include "stm32g4xx_hal_dma.h"
#include "stm32g4xx_hal_adc.h"
#include "stm32g4xx_hal_cortex.h"
#include "stm32g4xx_hal_flash.h"
#include "stm32g4xx_hal_i2c.h"
#include "stm32g4xx_hal_pwr.h"
#include "stm32g4xx_hal_tim.h"
#include "stm32g4xx_hal_uart.h"
/* clang-format on */

#define assert_param(expression) ((void)0)

#endif
