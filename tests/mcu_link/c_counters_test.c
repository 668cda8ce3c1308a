// A firmware in C whose file maps the counters service: the link fills and sends the message without a handler, and
// calls one that is there behind itself. Prints the counters, a line for each message. tests/test_c_link.py runs it.
#include <stdio.h>
#include <string.h>

#include "counted_link.h"

static uint8_t run[256];
static size_t run_size;
static uint8_t* ring;
static size_t place;
static bool is_own;

static bool start_receive(void* context, uint8_t* bytes, size_t size) {
  (void)context, (void)size;
  ring = bytes;
  return true;
}
static bool receiving(void* context) { return context == NULL; }
static size_t receive_position(void* context) { return context == NULL ? place : 0; }
static bool start_transmit(void* context, const uint8_t* bytes, size_t size) {
  (void)context;
  memcpy(run, bytes, size);
  run_size = size;
  return true;
}
static void stop_transmit(void* context) { (void)context; }
static void pend(void* context) { (void)context; }
static bool reaches(void* context, const void* bytes, size_t size) {
  return context == NULL && bytes != NULL && size != 0;
}
static bool fill_counts(void* context, counted_counts_t* counts) {
  (void)context;
  counts->own = 7;
  return is_own;
}

int main(void) {
  static const uint8_t noise[] = {1, 2, 3};
  static counted_link_handlers_t handlers;
  static wirebond_port_t port;
  counted_link_t* link;
  uint32_t now_us;
  port.start_receive = start_receive;
  port.receiving = receiving;
  port.receive_position = receive_position;
  port.start_transmit = start_transmit;
  port.stop_transmit = stop_transmit;
  port.pend = pend;
  port.reaches = reaches;
  link = counted_link_open(&handlers, &port);
  if (link == NULL) return 1;
  for (now_us = 0; now_us < 500000; now_us += 1000) {
    if (now_us == 50000) {
      memcpy(ring, noise, sizeof noise);
      place = sizeof noise;
      counted_link_on_received(link);
    }
    if (now_us == 250000) handlers.fill_counts = fill_counts;
    is_own = now_us < 350000;
    counted_link_poll(link, now_us);
    counted_link_on_pended(link);
    if (run_size != 0) {  // magic, id, no_start, sent, own, check
      printf("%u %u %u\n", run[2], run[3], run[4]);
      run_size = 0;
      counted_link_on_transmitted(link);
    }
  }
  return 0;
}
