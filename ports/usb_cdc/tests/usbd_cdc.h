/* A test double of ST's class CDC: the names that the port uses, with the behaviour that its source and RM0090 have. */
#ifndef USBD_CDC_H
#define USBD_CDC_H

#include <stdint.h>

#define CDC_IN_EP 0x81U
#define USBD_STATE_DEFAULT 1U
#define USBD_STATE_CONFIGURED 3U
#define USBD_STATE_SUSPENDED 4U

typedef enum { OTG_FS_IRQn = 67 } IRQn_Type;
typedef enum { USBD_OK, USBD_BUSY, USBD_EMEM, USBD_FAIL } USBD_StatusTypeDef;
typedef struct {
  const uint8_t* TxBuffer;
  uint32_t TxLength;
  volatile uint32_t TxState;
} USBD_CDC_HandleTypeDef;
typedef struct {
  volatile uint8_t dev_state;
  void* pClassData;
} USBD_HandleTypeDef;

#ifdef __cplusplus
extern "C" {
#endif
uint8_t USBD_CDC_SetTxBuffer(USBD_HandleTypeDef* pdev, uint8_t* pbuff, uint32_t length);
uint8_t USBD_CDC_TransmitPacket(USBD_HandleTypeDef* pdev);
uint8_t USBD_CDC_ReceivePacket(USBD_HandleTypeDef* pdev);
USBD_StatusTypeDef USBD_LL_FlushEP(USBD_HandleTypeDef* pdev, uint8_t ep_addr);
void NVIC_SetPendingIRQ(IRQn_Type IRQn);
#ifdef __cplusplus
}
#endif

#endif
