// Everything of the emulated board that a program uses.
#pragma once

#include "emulated_uart.hpp"
#include "report.hpp"
#include "software_dma.hpp"
#include "stm32f405.hpp"
#include "tasks.hpp"
