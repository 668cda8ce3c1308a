// A link in C that is polled every 20 ms, with the ring that it has by default and with one that is too small; and a
// handler that polls, and a DMA in normal mode. Built twice: tests/test_c_link.py. Prints what fails.
#include <stdio.h>
#include <string.h>

#include "diffdrive.h"
#include "diffdrive_link.h"

static int failures;

static void expect(bool held, const char* what) {
  if (held) return;
  ++failures;
  puts(what);
}

// ---- a port whose DMA stops where the test says so

static uint8_t* ring;
static size_t ring_size, place;
static bool is_receiving, is_pended;

static bool start_receive(void* context, uint8_t* bytes, size_t size) {
  (void)context;
  ring = bytes;
  ring_size = size;
  place = 0;
  is_receiving = true;
  return true;
}
static bool receiving(void* context) {
  (void)context;
  return is_receiving;
}
static size_t receive_position(void* context) {
  (void)context;
  return place;
}
static bool start_transmit(void* context, const uint8_t* bytes, size_t size) {
  (void)context;
  return bytes != NULL && size != 0;
}
static void stop_transmit(void* context) { (void)context; }
static void pend(void* context) {
  (void)context;
  is_pended = true;
}
static bool reaches(void* context, const void* bytes, size_t size) {
  (void)context;
  return bytes != NULL && size != 0;
}

static const wirebond_port_t port = {
    .start_receive = start_receive,
    .receiving = receiving,
    .receive_position = receive_position,
    .start_transmit = start_transmit,
    .stop_transmit = stop_transmit,
    .pend = pend,
    .reaches = reaches,
};

// ---- the rover

static diffdrive_link_t* uart;
static uint32_t now_us;
static int velocities;
static bool polls_in_handler;

static void on_velocity(void* context, const diffdrive_velocity_t* velocity) {
  (void)context;
  (void)velocity;
  ++velocities;
  if (polls_in_handler && velocities < 100) diffdrive_link_poll(uart, now_us);
}
static void on_stop(void* context) { (void)context; }

static const diffdrive_link_handlers_t handlers = {
    .on_velocity = on_velocity, .on_stop = on_stop, .on_safe_mode = on_stop};

static void come(void) {
  diffdrive_velocity_t velocity;
  diffdrive_init_velocity(&velocity);
  uint8_t frame[DIFFDRIVE_VELOCITY_MAX_FRAME_BYTES];
  size_t size = 0;
  if (diffdrive_encode_velocity(&velocity, frame, sizeof frame, &size) != WIREBOND_OK) ++failures;
  for (size_t i = 0; i < size; ++i) {
    ring[place] = frame[i];
    place = (place + 1) % ring_size;
  }
  diffdrive_link_on_received(uart);
}

static void poll(void) {
  diffdrive_link_poll(uart, now_us += 20000);
  while (is_pended) {
    is_pended = false;
    diffdrive_link_on_pended(uart);
    diffdrive_link_on_transmitted(uart);
  }
}

int main(void) {
  uart = diffdrive_link_open(&handlers, &port);
  if (uart == NULL) return 1;
  poll();
  for (int i = 0; i < 50; ++i) {
    come();
    come();
    poll();
  }
#ifdef IS_STARVED
  expect(velocities == 0, "the ring is too small for this loop");
  expect(diffdrive_link_why(uart) == WIREBOND_WHY_POLLED_TOO_SELDOM, "why names the ring");
#else
  expect(velocities == 100, "a loop of 20 ms gets every command");
  expect(diffdrive_link_why(uart) == WIREBOND_WHY_NOTHING, "nothing is wrong");

  polls_in_handler = true;
  velocities = 0;
  come();
  poll();
  expect(velocities == 1, "a poll in a handler reads nothing again");
  expect(diffdrive_link_counters(uart).nested_polls == 1, "it is counted");
  polls_in_handler = false;

  is_receiving = false;  // without an error event, as a DMA in normal mode
  poll();
  expect(is_receiving, "reception begins again at the next poll");
  expect(diffdrive_link_counters(uart).reception_stops == 1, "the stop is counted");
  expect(diffdrive_link_why(uart) == WIREBOND_WHY_RECEPTION_STOPS, "why names it");
  velocities = 0;
  come();
  poll();
  expect(velocities == 1, "commands come behind it");
#endif
  printf("%d\n", failures);
  return failures;
}
