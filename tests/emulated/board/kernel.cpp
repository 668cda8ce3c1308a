// What the FreeRTOS kernel asks of a program: broken assumptions end the run with a sentence, and idleness is rest.
#include "FreeRTOS.h"
#include "report.hpp"
#include "task.h"

extern "C" void assertion_failed(const char* file, int line) {
  board::print("assertion of the kernel at ");
  board::print(file);
  board::print(" line", static_cast<std::uint32_t>(line));
  board::fail("the kernel's assertion does not hold");
}

extern "C" void vApplicationStackOverflowHook(TaskHandle_t, char* name) {
  board::print(name);
  board::print(": ");
  board::fail("the task's stack is too small");
}

extern "C" void vApplicationIdleHook() { asm volatile("wfi"); }
