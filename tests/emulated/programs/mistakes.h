// The half in C of mistakes.cpp: a link whose port is given, and what it says. C99 and C++.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#include "wirebond/mcu/c_api.h"

#ifdef __cplusplus
extern "C" {
#endif

/// A link that was not used yet takes the place of the one before. The port outlives it.
bool c_link_open(const wirebond_port_t* port);
void c_link_poll(uint32_t now_us);
const char* c_link_why(void);

// of the UART's interrupt
void c_link_on_received(void);
void c_link_on_transmitted(void);
void c_link_on_pended(void);

#ifdef __cplusplus
}
#endif
