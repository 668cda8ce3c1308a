// What a program under emulation tells the test that runs it: lines and its end, by semihosting. No UART is used for
// it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace board {

inline std::uint32_t semihosting(std::uint32_t operation, std::uintptr_t argument) {
  register std::uint32_t r0 asm("r0") = operation;
  register std::uintptr_t r1 asm("r1") = argument;
  asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

/// One piece of a line; `"\n"` ends it. Any context, but pieces of two contexts may mix.
inline void print(const char* text) {
  constexpr std::uint32_t write_string = 0x04;
  semihosting(write_string, reinterpret_cast<std::uintptr_t>(text));
}

/// A line `name value`.
inline void print(const char* name, std::uint32_t value) {
  char digits[12];
  char* first = digits + sizeof digits;
  *--first = '\0';
  *--first = '\n';
  do {
    *--first = static_cast<char>('0' + value % 10);
    value /= 10;
  } while (value != 0);
  *--first = ' ';
  print(name);
  print(first);
}

/// The emulator ends, with this exit code.
[[noreturn]] inline void end(std::uint32_t code) {
  constexpr std::uint32_t exit_extended = 0x20;
  constexpr std::uint32_t application_exit = 0x20026;
  const std::uint32_t reason_and_code[] = {application_exit, code};
  for (;;) semihosting(exit_extended, reinterpret_cast<std::uintptr_t>(reason_and_code));
}

/// A broken assumption of the program: its sentence is the last line.
[[noreturn]] inline void fail(const char* sentence) {
  print("failed: ");
  print(sentence);
  print("\n");
  end(1);
}

}  // namespace board
