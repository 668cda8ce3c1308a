// The generated C API of frames with header fields and addresses: receivers, and a link on a port in memory. Prints
// each expectation that fails. tests/test_c_headers.py builds it with the protocol of
// tests/generate/code/every_header.yaml.
#include <stdio.h>
#include <string.h>

#include "headers.h"
#include "headers_link.h"

static int failures;

static void expect(bool held, const char* what) {
  if (held) return;
  ++failures;
  puts(what);
}

// ---- a port

static uint8_t* ring;
static size_t ring_size, place, run_size;
static uint8_t run[512];

static bool start_receive(void* context, uint8_t* bytes, size_t size) {
  (void)context;
  ring = bytes;
  ring_size = size;
  place = 0;
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

static const wirebond_port_t port = {.context = NULL,
                                     .start_receive = start_receive,
                                     .receiving = receiving,
                                     .receive_position = receive_position,
                                     .start_transmit = start_transmit,
                                     .stop_transmit = stop_transmit,
                                     .pend = pend,
                                     .reaches = reaches};

// ---- handlers

struct servo {
  int moves, asks, headed_asks, rests;
  unsigned stranger;
  float angle;
  headers_header_t header;
  wirebond_addressee_t addressee;
  headers_link_t* link;
};

static void on_move(void* context, const headers_move_t* move, const headers_header_t* header) {
  struct servo* servo = context;
  ++servo->moves;
  servo->angle = move->angle;
  servo->header = *header;
  if (servo->link != NULL) servo->addressee = headers_link_addressee(servo->link);
}
static void on_ask(void* context) { ++((struct servo*)context)->asks; }
static void on_ask_with_header(void* context, const headers_header_t* header) {
  struct servo* servo = context;
  ++servo->headed_asks;
  servo->header = *header;
}
static void unknown(void* context, const wirebond_frame_t* frame, const headers_header_t* header) {
  ((struct servo*)context)->stranger = frame->id == 0x55 ? header->servo : 0;
}
static bool fill_beat(void* context, headers_beat_t* beat, headers_header_t* header) {
  (void)context;
  beat->count = 9;
  header->kind = HEADERS_HEADER_KIND_READ;
  return true;
}
static void on_rest(void* context) { ++((struct servo*)context)->rests; }

static void on_answer(void* context, const headers_answer_t* answer, const headers_header_t* header) {
  struct servo* host = context;
  host->angle = answer->angle;
  host->header = *header;
  ++host->asks;
}
static void on_beat(void* context, const headers_beat_t* beat, const headers_header_t* header) {
  struct servo* host = context;
  host->header = *header;
  host->moves += beat->count;
}
static void on_pong(void* context, const headers_pong_t* pong, const headers_header_t* header) {
  struct servo* host = context;
  host->stranger = header->servo;
  host->rests += (int)pong->number;
}

// ---- without a link

static void receive(void) {
  static headers_from_host_t receiver;
  static struct servo servo;
  headers_from_host_handlers_t handlers;
  headers_header_t header;
  uint8_t frame[HEADERS_MOVE_MAX_FRAME_BYTES];
  size_t size = 0;
  headers_move_t move;

  memset(&handlers, 0, sizeof handlers);
  handlers.context = &servo;
  handlers.on_move_with_header = on_move;
  handlers.on_ask = on_ask;
  handlers.on_ask_with_header = on_ask_with_header;
  handlers.unknown_with_header = unknown;
  headers_from_host_init(&receiver, &handlers);

  headers_init_header_from_mcu(&header);
  expect(header.system == 1 && header.servo == 1, "the MCU's defaults");
  headers_init_header_from_host(&header);
  expect(header.system == 255 && header.kind == HEADERS_HEADER_KIND_PING, "the host's defaults");
  header.servo = 3;
  header.temperature = 36.6F;
  header.turn = -7;
  headers_init_move(&move);
  move.angle = 0.5F;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  headers_from_host_feed(&receiver, frame, size, 0);
  expect(servo.moves == 0 && headers_from_host_foreign(&receiver) == 1, "a frame for another acts");
  expect(headers_from_host_address(&receiver) == 1, "the address is not the file's default");
  expect(headers_from_host_set_address(&receiver, 3), "an address is refused");
  headers_from_host_feed(&receiver, frame, size, 0);
  expect(servo.moves == 1 && servo.angle == 0.5F, "a frame for this one does not act");
  expect(servo.header.temperature == 36.6F && servo.header.turn == -7 && servo.header.system == 255, "header values");

  expect(headers_encode_ask_with_header(&header, frame, sizeof frame, &size) == WIREBOND_OK, "encode ask");
  headers_from_host_feed(&receiver, frame, size, 0);
  expect(servo.headed_asks == 1 && servo.asks == 0, "of two functions not the one with the header is called");
  expect(headers_encode_ask(frame, sizeof frame, &size) == WIREBOND_OK, "encode ask without a header");
  headers_from_host_listen_to_all(&receiver);
  headers_from_host_feed(&receiver, frame, size, 0);
  expect(servo.headed_asks == 2 && servo.header.servo == 1, "who listens to all does not hear all");
  expect(headers_from_host_addressee(&receiver) == WIREBOND_ADDRESSEE_ANOTHER, "addressee");

  header.hops = 21;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OUT_OF_RANGE, "range");
  header.hops = 0;
  header.stamp = 7;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OUT_OF_RANGE, "form");
  header.state = HEADERS_HEADER_STATE_STAMPED;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OK, "longer form");
  headers_from_host_feed(&receiver, frame, size, 0);
  expect(servo.moves == 2 && servo.header.stamp == 7, "a value of the longer form");
}

static void stop_all(void) {
  headers_header_t header;
  headers_move_t move;
  memset(&header, 1, sizeof header);
  headers_emergency_stop(&move);
  headers_header_of_emergency_stop(&header);
  expect(move.angle == 0.0F, "the stop's value");
  expect(header.servo == 0xFE && header.temperature == 21.5F && header.system == 255, "the stop's header");
}

static int answers_heard;
static void on_one_answer(void* context, const headers_answer_t* answer) {
  (void)context;
  (void)answer;
  ++answers_heard;
}

static void ask_one_of_them(void) {
  static headers_from_mcu_t receiver;
  static headers_from_mcu_handlers_t handlers;
  uint8_t frame[HEADERS_ANSWER_MAX_FRAME_BYTES];
  size_t size;
  headers_header_t header;
  headers_answer_t answer;

  handlers.on_answer = on_one_answer;
  headers_from_mcu_init(&receiver, &handlers);
  headers_init_header_from_mcu(&header);
  headers_init_answer(&answer);
  header.servo = 4;
  expect(headers_encode_answer_with_header(&answer, &header, frame, sizeof frame, &size) == WIREBOND_OK,
         "encode answer");
  expect(!headers_from_mcu_expect_from(&receiver, HEADERS_MOVE_INDEX, 3), "a message without a reply is expected");
  expect(headers_from_mcu_expect_from(&receiver, HEADERS_ASK_INDEX, 3), "a request is refused");
  headers_from_mcu_feed(&receiver, frame, size, 0);
  expect(answers_heard == 0 && headers_from_mcu_foreign(&receiver) == 1, "another one's reply is taken");
  expect(headers_from_mcu_expect_from(&receiver, HEADERS_ASK_INDEX, 4), "a request is refused");
  headers_from_mcu_feed(&receiver, frame, size, 0);
  expect(answers_heard == 1 && headers_from_mcu_foreign(&receiver) == 1, "the reply of the one that was asked is not");
}

// ---- a link

static void arrive(headers_link_t* link, const uint8_t* bytes, size_t size, uint32_t* now_us) {
  size_t i;
  for (i = 0; i < size; ++i) {
    ring[place] = bytes[i];
    place = (place + 1) % ring_size;
  }
  headers_link_on_received(link);
  headers_link_poll(link, *now_us += 1000);
}

static void leave(headers_link_t* link, headers_from_mcu_t* host, uint32_t now_us) {
  headers_link_on_pended(link);
  while (run_size != 0) {
    headers_from_mcu_feed(host, run, run_size, now_us);
    run_size = 0;
    headers_link_on_transmitted(link);
  }
}

static void serve(void) {
  static struct servo servo, master;
  static headers_link_handlers_t handlers;
  static headers_from_mcu_t receiver;
  static headers_from_mcu_handlers_t heard;
  uint32_t now_us = 0;
  uint8_t frame[HEADERS_MOVE_MAX_FRAME_BYTES];
  size_t size = 0;
  headers_header_t header;
  headers_move_t move;
  headers_answer_t answer;
  headers_ping_t ping;
  headers_link_t* link;

  handlers.context = &servo;
  handlers.on_move_with_header = on_move;
  handlers.fill_beat_with_header = fill_beat;
  handlers.on_rest = on_rest;
  heard.context = &master;
  heard.on_answer_with_header = on_answer;
  heard.on_beat_with_header = on_beat;
  heard.on_pong_with_header = on_pong;
  headers_from_mcu_init(&receiver, &heard);
  link = headers_link_open(&handlers, &port);
  expect(link != NULL, "a link does not open");
  if (link == NULL) return;
  servo.link = link;
  expect(headers_link_address(link) == 1, "the link's address is not the file's default");
  expect(headers_link_set_address(link, 7), "an address is refused");
  headers_link_poll(link, now_us);
  leave(link, &receiver, now_us);
  expect(master.moves == 9 && master.header.servo == 7, "a beat does not carry the address");
  expect(master.header.kind == HEADERS_HEADER_KIND_READ, "a beat does not carry what was filled in");

  headers_init_header_from_host(&header);
  headers_init_move(&move);
  header.servo = 8;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(link, frame, size, &now_us);
  expect(servo.moves == 0 && headers_link_counters(link).foreign == 1, "a frame for another acts");
  expect(headers_link_state(link) == WIREBOND_STATE_UP, "a frame for another does not show that the line works");
  header.servo = 7;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(link, frame, size, &now_us);
  expect(servo.moves == 1 && servo.addressee == WIREBOND_ADDRESSEE_OWN, "a frame for this one");
  header.servo = 0xFE;
  expect(headers_encode_move_with_header(&move, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(link, frame, size, &now_us);
  expect(servo.moves == 2 && servo.addressee == WIREBOND_ADDRESSEE_ALL, "a broadcast");

  headers_init_ping(&ping);
  ping.number = 5;
  expect(headers_encode_ping_with_header(&ping, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(link, frame, size, &now_us);
  leave(link, &receiver, now_us);
  expect(master.rests == 0, "a broadcast is answered");
  header.servo = 7;
  expect(headers_encode_ping_with_header(&ping, &header, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(link, frame, size, &now_us);
  leave(link, &receiver, now_us);
  expect(master.rests == 5 && master.stranger == 7, "a ping is not answered with the address");

  headers_init_answer(&answer);
  answer.angle = 0.25F;
  expect(headers_send_answer(link, &answer) == WIREBOND_OK, "send");
  leave(link, &receiver, now_us);
  expect(master.asks == 1 && master.header.servo == 7 && master.header.system == 1, "an answer's header");
  headers_link_header(link, &header);
  expect(header.servo == 7 && header.system == 1, "the link's header");
  header.hops = 20;
  expect(headers_send_answer_with_header(link, &answer, &header) == WIREBOND_OK, "send with a header");
  leave(link, &receiver, now_us);
  expect(master.asks == 2 && master.header.hops == 20, "a header's value");
  header.hops = 21;
  expect(headers_send_answer_with_header(link, &answer, &header) == WIREBOND_OUT_OF_RANGE, "send out of range");
  expect(headers_link_send_account(link).refused_by[WIREBOND_REFUSED_RANGE] == 1, "a refusal is not counted");
}

int main(void) {
  receive();
  stop_all();
  ask_one_of_them();
  serve();
  printf("%d\n", failures);
  return failures;
}
