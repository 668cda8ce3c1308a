// The generated C API of links on a port that does what the test says. Prints each expectation that fails.
// Built with two links of native and one of diffdrive: tests/test_c_link.py.
#include <stdio.h>
#include <string.h>

#include "diffdrive.h"
#include "diffdrive_link.h"
#include "native.h"
#include "native_link.h"

static int failures;

static void expect(bool held, const char* what) {
  if (held) return;
  ++failures;
  puts(what);
}

// ---- a port

struct wire {
  uint8_t* ring;
  size_t size;
  size_t place;
  uint8_t run[512];
  size_t run_size;
  int clock_looks;
  int receive_starts;
  int transmit_stops;
  int line_frees;
  bool is_receiving;
  bool refuses_transmit;
  bool is_reachable;
  bool pended;
  bool is_away;
  size_t read;
  wirebond_line_errors_t errors;
};

static bool start_receive(void* context, uint8_t* ring, size_t size) {
  struct wire* wire = context;
  wire->ring = ring;
  wire->size = size;
  wire->place = 0;
  wire->is_receiving = true;
  ++wire->receive_starts;
  return true;
}

static bool receiving(void* context) { return ((struct wire*)context)->is_receiving; }

static size_t receive_position(void* context) { return ((struct wire*)context)->place; }

static bool start_transmit(void* context, const uint8_t* bytes, size_t size) {
  struct wire* wire = context;
  if (wire->refuses_transmit || size > sizeof wire->run) return false;
  memcpy(wire->run, bytes, size);
  wire->run_size = size;
  return true;
}

static void stop_transmit(void* context) { ++((struct wire*)context)->transmit_stops; }

static void pend(void* context) { ((struct wire*)context)->pended = true; }

static bool reaches(void* context, const void* bytes, size_t size) {
  return bytes != NULL && size != 0 && ((struct wire*)context)->is_reachable;
}

static wirebond_why_t setup; /* what the port says of its settings */
static wirebond_why_t check(void* context, uint32_t baud) {
  return context != NULL && baud == 115200 ? setup : WIREBOND_WHY_BAUD_DIFFERS;
}

static wirebond_line_errors_t take_line_errors(void* context) {
  struct wire* wire = context;
  const wirebond_line_errors_t errors = wire->errors;
  memset(&wire->errors, 0, sizeof wire->errors);
  return errors;
}

static bool connected(void* context) { return !((struct wire*)context)->is_away; }
static void stop_receive(void* context) { ((struct wire*)context)->is_receiving = false; }
static void read_to(void* context, size_t place) { ((struct wire*)context)->read = place; }

static void line_free(void* context) { ++((struct wire*)context)->line_frees; }

static wirebond_port_t port_over(struct wire* wire) {
  const wirebond_port_t port = {
      wire,  start_receive,    receiving, receive_position, start_transmit, stop_transmit, pend, reaches, NULL, false,
      check, take_line_errors, connected, stop_receive,     read_to,        line_free,     NULL, false};
  memset(wire, 0, sizeof *wire);
  wire->is_reachable = true;
  return port;
}

static void arrive(struct wire* wire, const uint8_t* bytes, size_t size) {
  for (size_t i = 0; i < size; ++i) {
    wire->ring[wire->place] = bytes[i];
    wire->place = (wire->place + 1) % wire->size;
  }
}

// ---- diffdrive: receiving, the schedule, deadlines, faults of the port

struct rover {
  int velocities;
  float linear;
  int stops;
  int safe_modes;
  bool has_odometry;
  wirebond_link_state_t state;
};

static void on_velocity(void* context, const diffdrive_velocity_t* velocity) {
  struct rover* rover = context;
  ++rover->velocities;
  rover->linear = velocity->linear;
}

static bool fill_odometry(void* context, diffdrive_odometry_t* odometry) {
  odometry->left_ticks = 7;
  return ((struct rover*)context)->has_odometry;
}

static void on_stop(void* context) { ++((struct rover*)context)->stops; }
static void on_safe_mode(void* context) { ++((struct rover*)context)->safe_modes; }

static void rover_state(void* context, wirebond_link_state_t state) { ((struct rover*)context)->state = state; }

static void drive(void) {
  static struct wire wire;
  static struct rover rover;
  static diffdrive_link_handlers_t handlers;
  static wirebond_port_t port;
  const uint32_t ms = 1000;
  uint32_t now_us = 0xFFFFFFFFU - 1500 * ms;  // the clock wraps while a deadline runs
  uint8_t frame[DIFFDRIVE_VELOCITY_MAX_FRAME_BYTES];
  size_t size = 0;
  diffdrive_velocity_t velocity;
  diffdrive_status_t status;
  diffdrive_link_t* link;
  int i;
  int starts;
  int frees;

  port = port_over(&wire);
  handlers.context = &rover;
  handlers.on_stop = on_stop;
  expect(diffdrive_link_open(&handlers, &port) == NULL, "a link opens without a function for a deadline");
  handlers.on_safe_mode = on_safe_mode;
  expect(diffdrive_link_open(NULL, &port) == NULL, "a link opens without handlers");
  expect(diffdrive_link_open(&handlers, NULL) == NULL, "a link opens without a port");
  port.stop_transmit = NULL;
  expect(diffdrive_link_open(&handlers, &port) == NULL, "a link opens without a function of its port");
  port.stop_transmit = stop_transmit;
  handlers.on_velocity = on_velocity;
  handlers.fill_odometry = fill_odometry;
  handlers.link_state = rover_state;
  link = diffdrive_link_open(&handlers, &port);
  expect(link != NULL, "a link does not open");
  if (link == NULL) return;
  expect(diffdrive_link_open(&handlers, &port) == NULL, "more links open than there are");

  diffdrive_init_status(&status);
  expect(diffdrive_send_status(link, &status) == WIREBOND_LINK_DOWN, "a link sends before it is polled");
  expect(diffdrive_link_why(link) == WIREBOND_WHY_NOT_POLLED, "why: not polled");
  wire.is_reachable = false;
  diffdrive_link_poll(link, now_us);
  expect(diffdrive_link_why(link) == WIREBOND_WHY_BUFFERS_UNREACHABLE, "why: buffers out of reach");
  expect(diffdrive_link_state(link) == WIREBOND_STATE_DOWN, "a link starts on memory that DMA does not reach");
  wire.is_reachable = true;
  diffdrive_link_poll(link, now_us);
  expect(wire.receive_starts == 1 && wire.size == 64, "the first poll does not start reception");
  expect(rover.state == WIREBOND_STATE_STALE, "the start is not told");
  for (setup = WIREBOND_WHY_UART_NOT_SET_UP; setup <= WIREBOND_WHY_INTERRUPT_OFF; ++setup) {
    expect(diffdrive_link_why(link) == setup, wirebond_why_text(setup));
  }
  setup = WIREBOND_WHY_NOTHING;
  expect(diffdrive_link_why(link) == WIREBOND_WHY_NOTHING_HEARD, "why: nothing heard");

  // Received bytes reach their handler.
  diffdrive_init_velocity(&velocity);
  velocity.linear = 0.5F;
  expect(diffdrive_encode_velocity(&velocity, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  arrive(&wire, frame, size);
  diffdrive_link_on_received(link);
  diffdrive_link_poll(link, now_us += ms);
  expect(rover.velocities == 1 && rover.linear == 0.5F, "a velocity does not come to its handler");
  expect(diffdrive_link_state(link) == WIREBOND_STATE_UP && rover.state == WIREBOND_STATE_UP, "the link is not up");
  expect(diffdrive_link_receive_account(link).handed_out == diffdrive_link_account(link).bytes, "the accounts differ");
  expect(diffdrive_link_account(link).bytes == size && diffdrive_link_account(link).frame_bytes == size, "bytes");
  expect(diffdrive_link_violations(link).rejected == 0, "violations");
  expect(diffdrive_link_why(link) == WIREBOND_WHY_NOTHING, "why: nothing is wrong");
  setup = WIREBOND_WHY_TICK_BELOW_UART;
  expect(diffdrive_link_why(link) == WIREBOND_WHY_TICK_BELOW_UART, "why: the tick");
  setup = WIREBOND_WHY_NOTHING;
  wire.is_receiving = false;
  expect(diffdrive_link_why(link) == WIREBOND_WHY_RECEPTION_STOPS, "why: reception stops");
  wire.is_receiving = true;

  // Both deadlines strike at their time: one second and three after the velocity.
  for (i = 0; i < 998; ++i) diffdrive_link_poll(link, now_us += ms);
  expect(rover.stops == 0, "the stop comes before its time");
  diffdrive_link_poll(link, now_us += ms);
  expect(rover.stops == 1 && !diffdrive_link_struck(link, DIFFDRIVE_ACTION_SAFE_MODE), "the stop does not come");
  for (i = 0; i < 2000; ++i) diffdrive_link_poll(link, now_us += ms);
  expect(rover.safe_modes == 1 && diffdrive_link_struck(link, DIFFDRIVE_ACTION_SAFE_MODE), "no safe mode");
  arrive(&wire, frame, size);
  diffdrive_link_on_received(link);
  diffdrive_link_poll(link, now_us += ms);
  expect(rover.velocities == 1 && diffdrive_link_counters(link).held_back == 1, "a command acts in safe mode");
  for (i = 0; i < 1000; ++i) diffdrive_link_poll(link, now_us += ms);
  diffdrive_link_recover(link, DIFFDRIVE_ACTION_SAFE_MODE);
  expect(!diffdrive_link_struck(link, DIFFDRIVE_ACTION_SAFE_MODE), "safe mode does not end");
  expect(rover.state == WIREBOND_STATE_STALE, "silence is not told");

  // A message that is due is filled and sent; the interrupt that was asked for starts it.
  rover.has_odometry = true;
  for (i = 0; i < 50; ++i) diffdrive_link_poll(link, now_us += ms);
  expect(wire.pended && wire.run_size == 0, "a run starts before the interrupt");
  expect(diffdrive_link_counters(link).unserved_pends > 1, "pends that nobody served are not counted");
  expect(diffdrive_link_why(link) == WIREBOND_WHY_PENDS_UNSERVED, "why: pends are not served");
  wire.pended = false;
  diffdrive_link_on_pended(link);
  {
    diffdrive_odometry_t odometry;
    uint8_t wanted[DIFFDRIVE_ODOMETRY_MAX_FRAME_BYTES];
    diffdrive_init_odometry(&odometry);
    odometry.left_ticks = 7;
    expect(diffdrive_encode_odometry(&odometry, wanted, sizeof wanted, &size) == WIREBOND_OK, "encode");
    expect(wire.run_size == size && memcmp(wire.run, wanted, size) == 0, "odometry is not what was filled in");
  }
  rover.has_odometry = false;
  frees = wire.line_frees;
  diffdrive_link_on_transmitted(link);
  expect(diffdrive_link_send_account(link).sent == 1, "a frame that left is not counted");
  expect(wire.line_frees == frees + 1, "a port is not told that nothing follows");

  // A poll that comes too late, on a port without a clock.
  arrive(&wire, frame, size);
  diffdrive_link_on_received(link);
  diffdrive_link_poll(link, now_us += 600 * ms);
  expect(rover.velocities == 1, "an old command acts");
  expect(diffdrive_link_counters(link).slow_polls == 1, "a slow poll is not counted");
  expect(diffdrive_link_counters(link).late == 0 && diffdrive_link_counters(link).nested_polls == 0, "other counters");
  {
    const wirebond_receive_account_t account = diffdrive_link_receive_account(link);
    expect(account.laps_unknown == 1 && account.dropped == size, "what was dropped is not counted");
    expect(account.received == account.handed_out + account.lapped + account.dropped, "what was received");
  }
  arrive(&wire, frame, size);
  diffdrive_link_poll(link, now_us += ms);
  diffdrive_link_on_pended(link);
  expect(diffdrive_link_why(link) == WIREBOND_WHY_SLOW_WITHOUT_CLOCK, "why: a command may act late");
  wire.pended = false;

  // Answers and faults.
  status.battery = 1e9F;
  expect(diffdrive_send_status(link, &status) == WIREBOND_OUT_OF_RANGE, "a value out of range is sent");
  expect(wire.pended, "the room that was given back stays lost");
  diffdrive_link_on_pended(link);
  diffdrive_init_status(&status);
  wire.refuses_transmit = true;
  for (i = 0; diffdrive_send_status(link, &status) == WIREBOND_OK; ++i) expect(i < 4, "more frames than the table has");
  expect(i == 4, "the queue is full too early");
  expect(diffdrive_send_status(link, &status) == WIREBOND_QUEUE_FULL, "a full queue does not say so");
  diffdrive_link_on_pended(link);
  expect(diffdrive_link_counters(link).transmit_retries == 1, "a refused run is not counted");
  wire.refuses_transmit = false;
  diffdrive_link_poll(link, now_us += ms);
  diffdrive_link_on_pended(link);
  for (i = 0; i < 30; ++i) diffdrive_link_poll(link, now_us += ms);  // and it never leaves
  diffdrive_link_on_pended(link);
  expect(wire.transmit_stops == 1 && diffdrive_link_counters(link).transmit_timeouts == 1, "a stuck run stays");
  wire.is_receiving = false;
  diffdrive_link_on_error(link);
  expect(wire.is_receiving && diffdrive_link_counters(link).line_errors == 1, "reception does not begin anew");
  starts = wire.receive_starts;
  wire.errors.framing = wire.errors.overrun = true;
  diffdrive_link_on_received(link);
  wire.errors.noise = wire.errors.parity = wire.errors.framing = true;
  diffdrive_link_on_pended(link);
  {
    const wirebond_link_counters_t counters = diffdrive_link_counters(link);
    expect(counters.line_errors == 3 && counters.framing_errors == 2, "looks that found framing errors");
    expect(counters.noise_errors == 1 && counters.overruns == 1 && counters.parity_errors == 1, "errors by kind");
    expect(wire.receive_starts == starts, "line errors end reception");
  }
  expect(diffdrive_link_next_due_us(link, now_us) - now_us <= 100 * ms, "the link sleeps too long");
  expect(diffdrive_link_counters(link).clock_steps == 0, "steps of the clock without one");
  diffdrive_link_poll(link, now_us - 3 * ms / 2);
  expect(diffdrive_link_counters(link).clock_steps == 1, "a step of the clock is not counted");
  expect(!diffdrive_link_struck(link, DIFFDRIVE_ACTION_STOP), "a step of the clock strikes a deadline");
  diffdrive_link_stop(link);
  diffdrive_link_poll(link, now_us += ms);
  diffdrive_link_on_pended(link);
  expect(diffdrive_link_state(link) == WIREBOND_STATE_DOWN && !wire.is_receiving, "a stopped link is not down");
  expect(diffdrive_link_why(link) == WIREBOND_WHY_NOT_CONNECTED, "it does not say why");
  expect(diffdrive_link_send_account(link).queued == 0, "what waits does not expire");
  diffdrive_link_start(link);
  wire.is_away = true;
  diffdrive_link_poll(link, now_us += ms);
  diffdrive_link_on_pended(link);
  expect(diffdrive_link_state(link) == WIREBOND_STATE_DOWN, "a link is up though nobody reads");
  wire.is_away = false;
  diffdrive_link_poll(link, now_us += ms);
  expect(diffdrive_link_state(link) == WIREBOND_STATE_STALE && wire.is_receiving, "a link does not come back");
  arrive(&wire, (const uint8_t*)"abc", 3);
  diffdrive_link_poll(link, now_us += ms);
  expect(wire.read == 3, "the port is not told what was read");
  {
    const wirebond_send_account_t account = diffdrive_link_send_account(link);
    uint32_t refused = 0;
    for (i = 0; i < WIREBOND_REFUSAL_COUNT; ++i) refused += account.refused_by[i];
    expect(account.refused_by[WIREBOND_REFUSED_DOWN] == 1 && account.refused_by[WIREBOND_REFUSED_RANGE] == 1,
           "refusals");
    expect(account.refused_by[WIREBOND_REFUSED_FULL] == 2 && account.aborted != 0, "refusals of a full queue");
    expect(account.offered == account.accepted + account.unfinished + refused, "what was offered");
    expect(account.accepted == account.sent + account.queued + account.replaced + account.expired + account.aborted,
           "what was accepted");
  }
}

// ---- native: services, and two links

static const wirebond_parameter_rule_t rules[2] = {{0.0F, 10.0F, 1.0F}, {-1.0F, 1.0F, 0.5F}};

struct arm {
  int unknown_frames;
  int stored;
  size_t index;
  float value;
  int commands;
  uint32_t* takes_us; /* the clock, where storing takes long */
};

static void stop_arm(void* context) { (void)context; }

static void on_unknown(void* context, const wirebond_frame_t* frame) {
  if (frame->id == NATIVE_STATE_ID) ++((struct arm*)context)->unknown_frames;
}

static void parameter_set(void* context, size_t index, float value) {
  struct arm* arm = context;
  ++arm->stored;
  arm->index = index;
  arm->value = value;
  if (arm->takes_us != NULL) *arm->takes_us += 2000000;  // it erases flash
}

static void on_command(void* context, const native_command_t* command) {
  (void)command;
  ++((struct arm*)context)->commands;
}

struct host {
  int hellos;
  uint32_t pong;
  uint64_t clock;
  char line[64];
  native_log_level_t level;
  native_parameter_value_t value;
};

static void on_hello(void* context, const native_hello_t* hello) {
  if (hello->protocol_hash == NATIVE_PROTOCOL_HASH) ++((struct host*)context)->hellos;
}

static void on_pong(void* context, const native_pong_t* pong) { ((struct host*)context)->pong = pong->number; }

static void on_clock_reply(void* context, const native_clock_reply_t* reply) {
  ((struct host*)context)->clock = reply->host_us;
}

static void on_log(void* context, const native_log_t* log) {
  struct host* host = context;
  memcpy(host->line, log->text.data, log->text.size);
  host->line[log->text.size] = '\0';
  host->level = log->level;
}

static void on_parameter_value(void* context, const native_parameter_value_t* value) {
  ((struct host*)context)->value = *value;
}

static struct wire arm_wire;
static native_link_t* arm_link;
static native_from_mcu_t host_receiver;
static uint32_t arm_us;

static uint32_t arm_clock(void* context) {
  ++((struct wire*)context)->clock_looks;
  return arm_us;
}

/// The request comes in, and what the MCU answers goes to the host.
static void ask(const uint8_t* frame, size_t size) {
  arrive(&arm_wire, frame, size);
  native_link_on_received(arm_link);
  native_link_poll(arm_link, arm_us += 1000);
  native_link_on_pended(arm_link);
  while (arm_wire.run_size != 0) {
    uint8_t run[sizeof arm_wire.run];
    const size_t run_size = arm_wire.run_size;
    memcpy(run, arm_wire.run, run_size);
    arm_wire.run_size = 0;
    native_from_mcu_feed(&host_receiver, run, run_size, arm_us);
    native_link_on_transmitted(arm_link);
  }
}

#define ASK(message, encode)                                                         \
  do {                                                                               \
    uint8_t frame[64];                                                               \
    size_t size = 0;                                                                 \
    expect(encode(&(message), frame, sizeof frame, &size) == WIREBOND_OK, #message); \
    ask(frame, size);                                                                \
  } while (0)

// ---- native: the wrong time

static uint32_t ticks;
static uint32_t tick_ms(void* context) {
  (void)context;
  return ticks;
}

static void tell_time(void) {
  static struct wire wire;
  static struct arm arm;
  static native_link_handlers_t handlers;
  static wirebond_port_t port;
  native_link_t* link;
  uint8_t frame[NATIVE_COMMAND_MAX_FRAME_BYTES];
  size_t size = 0;
  native_command_t command;
  int i;

  port = port_over(&wire);
  port.check = NULL;
  port.tick_ms = tick_ms;
  handlers.context = &arm;
  handlers.on_stop = stop_arm;
  link = native_link_open(&handlers, &port);
  expect(link != NULL, "a link for the time does not open");
  if (link == NULL) return;
  native_init_command(&command);
  expect(native_encode_command(&command, frame, sizeof frame, &size) == WIREBOND_OK, "encode");
  for (i = 0; i < 1000; ++i) {
    native_link_poll_ms(link, ++ticks);
    native_link_on_pended(link);
    if (wire.run_size != 0) native_link_on_transmitted(link);
    wire.run_size = 0;
    if (i % 10 == 0) arrive(&wire, frame, size);
  }
  expect(native_link_why(link) == WIREBOND_WHY_NOTHING, "why: milliseconds are said to be wrong");
  for (i = 0; i < 1000; ++i) { /* they are given as microseconds */
    native_link_poll(link, ++ticks);
    native_link_on_pended(link);
    if (wire.run_size != 0) native_link_on_transmitted(link);
    wire.run_size = 0;
    if (i % 10 == 0) arrive(&wire, frame, size);
  }
  expect(native_link_why(link) == WIREBOND_WHY_WRONG_TIME_BASE, "why: the wrong time base");
}

/// A frame of parameter_set, index 1, whose value is NaN, which no encoder makes.
static const uint8_t not_a_number[] = {0x00, 0x03, 0x77, 0x01, 0x01, 0x05, 0xC0, 0x7F, 0xC1, 0x64, 0x00};

static void serve(void) {
  static struct arm arm;
  static struct host host;
  static float values[2];
  static native_link_handlers_t handlers;
  static native_from_mcu_handlers_t host_handlers;
  static wirebond_port_t port;
  native_hello_t hello = {NATIVE_PROTOCOL_HASH, 1};
  const native_ping_t ping = {0xFEDCBA98U};
  const native_clock_request_t request = {123456789012U};
  native_parameter_set_t set = {1, -0.25F};
  const native_parameter_read_t read = {7};
  native_state_t state;
  uint32_t own_frames;
  char line[49];

  port = port_over(&arm_wire);
  port.now_us = arm_clock;
  port.tells_every_lap = true;
  handlers.context = &arm;
  handlers.on_stop = stop_arm;
  handlers.on_command = on_command;
  handlers.unknown = on_unknown;
  handlers.parameters.rules = rules;
  handlers.parameters.count = 2;
  handlers.parameter_set = parameter_set;
  expect(native_link_open(&handlers, &port) == NULL, "parameters without memory are accepted");
  handlers.parameters.values = values;
  arm_link = native_link_open(&handlers, &port);
  expect(arm_link != NULL, "the first link does not open");
  if (arm_link == NULL) return;
  expect(values[0] == 1.0F && values[1] == 0.5F, "parameters do not begin with their initial values");

  host_handlers.context = &host;
  host_handlers.on_hello = on_hello;
  host_handlers.on_pong = on_pong;
  host_handlers.on_clock_reply = on_clock_reply;
  host_handlers.on_log = on_log;
  host_handlers.on_parameter_value = on_parameter_value;
  native_from_mcu_init(&host_receiver, &host_handlers);

  ask(NULL, 0);
  expect(host.hellos == 1 && native_link_peer(arm_link) == WIREBOND_PEER_UNKNOWN, "hello is not said at the start");
  ASK(hello, native_encode_hello);
  expect(host.hellos == 2 && native_link_peer(arm_link) == WIREBOND_PEER_SAME, "hello is not answered");
  hello.protocol_hash += 1;
  ASK(hello, native_encode_hello);
  expect(native_link_peer(arm_link) == WIREBOND_PEER_DIFFERENT, "another file is not told apart");
  ASK(set, native_encode_parameter_set);
  expect(values[1] == 0.5F && native_link_counters(arm_link).held_back == 1, "a host of another file sets a parameter");
  hello.protocol_hash -= 1; /* of this file again: such a host's messages act */
  ASK(hello, native_encode_hello);
  ASK(ping, native_encode_ping);
  expect(host.pong == ping.number, "a ping is not echoed");
  ASK(request, native_encode_clock_request);
  expect(host.clock == request.host_us, "the clock does not answer");

  ASK(set, native_encode_parameter_set);
  expect(values[1] == -0.25F && host.value.value == -0.25F, "a parameter is not set");
  expect(arm.stored == 1 && arm.index == 1 && arm.value == -0.25F, "what was set is not given to be stored");

  // A command that waits in the ring while a handler takes two seconds; its deadline is 200 ms.
  {
    native_command_t command;
    uint8_t frames[64];
    size_t set_size = 0;
    size_t size = 0;
    native_init_command(&command);
    command.speed = 1.0F; /* no stop, which acts at any age */
    expect(native_encode_parameter_set(&set, frames, sizeof frames, &set_size) == WIREBOND_OK, "encode");
    expect(native_encode_command(&command, frames + set_size, sizeof frames - set_size, &size) == WIREBOND_OK,
           "encode");
    arm.takes_us = &arm_us;
    ask(frames, set_size + size);
    arm.takes_us = NULL;
    expect(arm.stored == 2 && arm.commands == 0, "a command acts late, after a slow handler");
    expect(native_link_counters(arm_link).late == 1, "a command after a slow handler is not counted as late");
    expect(native_link_why(arm_link) != WIREBOND_WHY_SLOW_WITHOUT_CLOCK, "why: there is a clock");
    ask(NULL, 0);
    ask(frames + set_size, size);
    expect(arm.commands == 1, "a command after that does not act");
  }

  set.value = 2.0F;
  ASK(set, native_encode_parameter_set);
  expect(host.value.result == NATIVE_PARAMETER_VALUE_RESULT_OUT_OF_RANGE, "a value out of range is not refused");
  expect(values[1] == -0.25F && arm.stored == 2, "a value out of range is taken");
  memset(&host.value, 0, sizeof host.value);
  ask(not_a_number, sizeof not_a_number);
  expect(host.value.result == NATIVE_PARAMETER_VALUE_RESULT_OUT_OF_RANGE && host.value.value == -0.25F,
         "a value that breaks its field's rule is not refused");
  ASK(read, native_encode_parameter_read);
  expect(host.value.result == NATIVE_PARAMETER_VALUE_RESULT_NO_SUCH_INDEX, "an index that is none has a value");

  own_frames = native_link_counters(arm_link).own_frames; /* a hello that equals the own one is counted */
  native_init_state(&state);
  ASK(state, native_encode_state);
  expect(arm.unknown_frames == 1, "a frame that the host does not send is not handed out as unknown");
  expect(native_link_account(arm_link).unknown_frames == 1, "an unknown frame is not counted");
  expect(native_link_counters(arm_link).own_frames == own_frames + 1,
         "a frame that only the MCU sends is not counted as an own one");

  expect(native_link_log(arm_link, WIREBOND_LEVEL_WARNING, "motor 2 is warm") == WIREBOND_OK, "log");
  ask(NULL, 0);
  expect(strcmp(host.line, "motor 2 is warm") == 0 && host.level == NATIVE_LOG_LEVEL_WARNING, "the line differs");
  memset(line, 'x', sizeof line);  // without an end: only so much is read as the message holds
  expect(native_link_log(arm_link, WIREBOND_LEVEL_INFO, line) == WIREBOND_OK, "log of a long line");
  ask(NULL, 0);
  expect(strlen(host.line) == 48, "a long line is not cut");
  expect(native_link_log(arm_link, WIREBOND_LEVEL_INFO, NULL) == WIREBOND_OK, "log of no line");

  expect(arm_wire.clock_looks > 0, "the clock is not asked when bytes come");
  arm_us += 10000000;  // longer than the ring takes to fill
  ASK(ping, native_encode_ping);
  expect(native_link_receive_account(arm_link).laps_unknown == 0, "a port without DMA is said to be lapped");

  // A second link has its own memory.
  {
    static struct wire other_wire;
    static wirebond_port_t other_port;
    native_link_t* other;
    other_port = port_over(&other_wire);
    handlers.parameters.count = 0;
    other = native_link_open(&handlers, &other_port);
    expect(other != NULL && other != arm_link, "the second link does not open");
    expect(native_link_open(&handlers, &other_port) == NULL, "a third link opens");
    if (other == NULL) return;
    native_link_poll(other, 0);
    expect(other_wire.ring != arm_wire.ring, "two links share a ring");
    expect(native_link_send_account(other).sent == 0, "two links share an account");
  }
}

int main(void) {
  drive();
  tell_time(); /* before the last link of native is open */
  serve();
  printf("%d\n", failures);
  return failures != 0;
}
