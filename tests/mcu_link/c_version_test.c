// The generated C API of a format in two versions: a link answers in the version that it was asked in. Prints each
// expectation that fails. tests/test_c_headers.py builds it with protocols/contrib/msp.yaml.
#include <stdio.h>
#include <string.h>

#include "msp.h"
#include "msp_link.h"

static int failures;

static void expect(bool held, const char* what) {
  if (held) return;
  ++failures;
  puts(what);
}

// ---- a port

static uint8_t* ring;
static size_t ring_size, place, run_size;
static uint8_t run[256];

static bool start_receive(void* context, uint8_t* bytes, size_t size) {
  (void)context;
  ring = bytes;
  ring_size = size;
  return true;
}
static bool receiving(void* context) {
  (void)context;
  return true;
}
static size_t receive_position(void* context) {
  (void)context;
  return place;
}
static bool start_transmit(void* context, const uint8_t* bytes, size_t size) {
  (void)context;
  if (size > sizeof run) return false;
  memcpy(run, bytes, size);
  run_size = size;
  return true;
}
static void stop_transmit(void* context) { (void)context; }
static void pend(void* context) { (void)context; }
static bool reaches(void* context, const void* bytes, size_t size) {
  (void)context;
  return bytes != NULL && size != 0;
}

// ---- a flight controller

static msp_link_t* board;
static uint32_t now_us;

static void on_read_attitude(void* context) {
  msp_attitude_t attitude;
  (void)context;
  msp_init_attitude(&attitude);
  attitude.heading = 90;
  expect(msp_send_attitude(board, &attitude) == WIREBOND_OK, "send");
}

/// The start of what it answers to an empty request 108 whose frame begins with `magic`.
static uint32_t answered(uint32_t magic) {
  uint8_t frame[MSP_READ_ATTITUDE_MAX_FRAME_BYTES];
  size_t size = 0, i;
  msp_header_t header;
  msp_init_header_from_host(&header);
  header.magic = magic;
  expect(msp_encode_read_attitude_with_header(&header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  for (i = 0; i < size; ++i) {
    ring[place] = frame[i];
    place = (place + 1) % ring_size;
  }
  run_size = 0;
  msp_link_on_received(board);
  now_us += 1000;
  msp_link_poll(board, now_us);
  msp_link_on_pended(board);
  if (run_size == 0) return 0;
  msp_link_on_transmitted(board);
  return (uint32_t)run[0] << 16 | (uint32_t)run[1] << 8 | run[2];
}

int main(void) {
  static const wirebond_port_t port = {.context = NULL,
                                       .start_receive = start_receive,
                                       .receiving = receiving,
                                       .receive_position = receive_position,
                                       .start_transmit = start_transmit,
                                       .stop_transmit = stop_transmit,
                                       .pend = pend,
                                       .reaches = reaches};
  static msp_link_handlers_t handlers;
  handlers.on_read_attitude = on_read_attitude;
  board = msp_link_open(&handlers, &port);
  expect(board != NULL, "a link does not open");
  if (board == NULL) return 1;
  msp_link_poll(board, now_us += 1000);
  expect(answered(0x244D3C) == 0x244D3E, "version 1 is not answered in version 1");
  expect(answered(0x24583C) == 0x24583E, "version 2 is not answered in version 2");
  printf("%d\n", failures);
  return failures;
}
