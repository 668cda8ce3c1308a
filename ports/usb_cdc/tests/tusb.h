/* A test double of TinyUSB's class CDC: the functions that the port uses, as its header describes them. */
#ifndef TUSB_H
#define TUSB_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
bool tud_cdc_n_connected(uint8_t itf);
uint32_t tud_cdc_n_read(uint8_t itf, void* buffer, uint32_t bufsize);
void tud_cdc_n_read_flush(uint8_t itf);
uint32_t tud_cdc_n_write(uint8_t itf, const void* buffer, uint32_t bufsize);
uint32_t tud_cdc_n_write_flush(uint8_t itf);
bool tud_cdc_n_write_clear(uint8_t itf);
#ifdef __cplusplus
}
#endif

#endif
