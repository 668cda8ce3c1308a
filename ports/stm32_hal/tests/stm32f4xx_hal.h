/* A test double of the vendor's HAL: the types and functions that the port uses, as the vendor's manual (UM1725)
   describes them. Behind them stands the UART of fake/. */
#ifndef STM32F4XX_HAL_H
#define STM32F4XX_HAL_H

#include <stdint.h>

#define STM32F4
#define HAL_UART_MODULE_ENABLED
#ifndef USE_HAL_UART_REGISTER_CALLBACKS
#define USE_HAL_UART_REGISTER_CALLBACKS 0
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { USART2_IRQn = 38, USART3_IRQn = 39 } IRQn_Type;
typedef enum { HAL_OK, HAL_ERROR, HAL_BUSY, HAL_TIMEOUT } HAL_StatusTypeDef;
typedef enum {
  HAL_UART_STATE_RESET = 0,
  HAL_UART_STATE_READY = 0x20,
  HAL_UART_STATE_BUSY_TX = 0x21,
  HAL_UART_STATE_BUSY_RX = 0x22
} HAL_UART_StateTypeDef;
typedef enum { HAL_UART_TX_COMPLETE_CB_ID = 1, HAL_UART_ERROR_CB_ID = 4 } HAL_UART_CallbackIDTypeDef;

#define DMA_NORMAL 0x0U
#define DMA_CIRCULAR 0x100U
typedef struct {
  uint32_t Mode;
} DMA_InitTypeDef;
typedef struct {
  uint32_t BaudRate;
} UART_InitTypeDef;
typedef struct {
  uint32_t ISER[8];
} NVIC_Type;

typedef enum { GPIO_PIN_RESET = 0, GPIO_PIN_SET } GPIO_PinState;
typedef struct {
  volatile uint32_t ODR;
} GPIO_TypeDef;
extern GPIO_TypeDef gpio_b_registers;
#define GPIOB (&gpio_b_registers)
#define GPIO_PIN_14 ((uint16_t)0x4000)

#define USART_CR1_PEIE 0x100U
#define USART_CR3_EIE 0x1U
#define UART_FLAG_PE 0x1U
#define UART_FLAG_FE 0x2U
#define UART_FLAG_NE 0x4U
#define UART_FLAG_ORE 0x8U
typedef struct {
  volatile uint32_t SR, DR, BRR, CR1, CR2, CR3, GTPR;
} USART_TypeDef;

typedef struct {
  DMA_InitTypeDef Init;
  struct __UART_HandleTypeDef* Parent;
} DMA_HandleTypeDef;

typedef struct __UART_HandleTypeDef {
  USART_TypeDef* Instance;
  UART_InitTypeDef Init;
  DMA_HandleTypeDef* hdmatx;
  DMA_HandleTypeDef* hdmarx;
  uint16_t RxXferSize;
  HAL_UART_StateTypeDef gState;
  HAL_UART_StateTypeDef RxState;
  void* uart; /* of fake/ */
#if USE_HAL_UART_REGISTER_CALLBACKS == 1
  void (*TxCpltCallback)(struct __UART_HandleTypeDef* huart);
  void (*ErrorCallback)(struct __UART_HandleTypeDef* huart);
  void (*RxEventCallback)(struct __UART_HandleTypeDef* huart, uint16_t Pos);
#endif
} UART_HandleTypeDef;

HAL_StatusTypeDef HAL_UARTEx_ReceiveToIdle_DMA(UART_HandleTypeDef* huart, uint8_t* pData, uint16_t Size);
HAL_StatusTypeDef HAL_UART_Transmit_DMA(UART_HandleTypeDef* huart, const uint8_t* pData, uint16_t Size);
HAL_StatusTypeDef HAL_UART_AbortReceive(UART_HandleTypeDef* huart);
HAL_StatusTypeDef HAL_UART_AbortTransmit(UART_HandleTypeDef* huart);
uint32_t __HAL_DMA_GET_COUNTER(const DMA_HandleTypeDef* hdma); /* a macro in the vendor's */
void HAL_GPIO_WritePin(GPIO_TypeDef* GPIOx, uint16_t GPIO_Pin, GPIO_PinState PinState);
void NVIC_SetPendingIRQ(IRQn_Type IRQn);
uint32_t NVIC_GetPriority(IRQn_Type IRQn);
extern NVIC_Type nvic_registers;
#define NVIC (&nvic_registers)
uint32_t HAL_GetTick(void);
extern uint32_t uwTickPrio;

#if USE_HAL_UART_REGISTER_CALLBACKS == 1
typedef void (*pUART_CallbackTypeDef)(UART_HandleTypeDef* huart);
typedef void (*pUART_RxEventCallbackTypeDef)(UART_HandleTypeDef* huart, uint16_t Pos);
HAL_StatusTypeDef HAL_UART_RegisterCallback(UART_HandleTypeDef* huart, HAL_UART_CallbackIDTypeDef CallbackID,
                                            pUART_CallbackTypeDef pCallback);
HAL_StatusTypeDef HAL_UART_RegisterRxEventCallback(UART_HandleTypeDef* huart, pUART_RxEventCallbackTypeDef pCallback);
#else
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef* huart, uint16_t Size);
void HAL_UART_TxCpltCallback(UART_HandleTypeDef* huart);
void HAL_UART_ErrorCallback(UART_HandleTypeDef* huart);
#endif

#ifdef __cplusplus
}
#endif
#endif
