/* The HAL's settings for these tests: its UART and DMA drivers, no register callbacks. */
#ifndef STM32F4XX_HAL_CONF_H
#define STM32F4XX_HAL_CONF_H

#define HAL_MODULE_ENABLED
#define HAL_DMA_MODULE_ENABLED
#define HAL_GPIO_MODULE_ENABLED
#define HAL_RCC_MODULE_ENABLED
#define HAL_UART_MODULE_ENABLED

#define HSE_VALUE 8000000U
#define HSI_VALUE 16000000U
#define USE_RTOS 0U
#define USE_HAL_UART_REGISTER_CALLBACKS 0U

/* Each needs some of those before it. */
/* clang-format off */
#include "stm32f4xx_hal_rcc.h"
#include "stm32f4xx_hal_gpio.h"
#include "stm32f4xx_hal_dma.h"
#include "stm32f4xx_hal_uart.h"
/* clang-format on */

#define assert_param(expression) ((void)0)

#endif
