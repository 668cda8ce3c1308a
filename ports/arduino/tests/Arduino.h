/* A stub of Arduino's core: what a sketch with the port uses. Boards differ in what `availableForWrite` says and in the
   overloads of `write`; ARDUINO_ARCH_... chooses, as the boards' own builds do. */
#ifndef ARDUINO_H
#define ARDUINO_H

#include <stddef.h>
#include <stdint.h>

#include <deque>

unsigned long micros();
unsigned long millis();

class Print {
 public:
  virtual ~Print() = default;
  virtual size_t write(uint8_t byte) = 0;
  virtual size_t write(const uint8_t* bytes, size_t size) {
    size_t count = 0;
    while (size-- != 0) count += write(*bytes++);
    return count;
  }
#if defined(ARDUINO_ARCH_ESP32)
  size_t write(const char* bytes, size_t size) { return write(reinterpret_cast<const uint8_t*>(bytes), size); }
#endif
  virtual int availableForWrite() { return 0; }
  virtual void flush() {}
};

class Stream : public Print {
 public:
  virtual int available() = 0;
  virtual int read() = 0;
  virtual int peek() = 0;
};

/// Its far end is in `come` and `gone`.
class HardwareSerial : public Stream {
 public:
  void begin(unsigned long baud) { rate = baud; }
  int available() override { return static_cast<int>(come.size()); }
  int peek() override { return come.empty() ? -1 : come.front(); }
  int read() override {
    const int byte = peek();
    if (byte >= 0) come.pop_front();
    return byte;
  }
  size_t write(uint8_t byte) override {
    gone.push_back(byte);
    return 1;
  }
  using Print::write;
#if defined(ARDUINO_ARCH_RP2040)
  int availableForWrite() override { return 1; }  // the UART takes bytes one by one
#elif !defined(ARDUINO_ARCH_SAMD)
  int availableForWrite() override { return room; }
#endif

  void flush() override { ++flushes; }

  unsigned long rate = 0;
  int flushes = 0;
  int room = 32;
  std::deque<uint8_t> come, gone;
};
extern HardwareSerial Serial, Serial1;

constexpr uint8_t LOW = 0, HIGH = 1, OUTPUT = 1, A0 = 14, A1 = 15;
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t level);
int analogRead(uint8_t pin);

#endif
