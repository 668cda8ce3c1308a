// What the C headers of all protocols share: answers, counters, frames, a link's port. C99, C11 and C++; no function
// lives here.
#ifndef WIREBOND_C_API_H
#define WIREBOND_C_API_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// By its place beside this file: C sources may be compiled without an include folder.
#include "why.h"

/// Of a function whose answer says that nothing was done: GCC and Clang warn where the answer is not looked at. A cast
/// to `void` does not help with GCC. Look at it, also where there is nothing to do:
///     if (..._send_status(link, &status) != WIREBOND_OK) { /* the link has counted it; the next one is due soon */ }
#if defined(__GNUC__)
#define WIREBOND_MUST_CHECK __attribute__((warn_unused_result))
#else
#define WIREBOND_MUST_CHECK
#endif

#ifdef __cplusplus
extern "C" {
#endif

/// What became of an encode or a send. Only WIREBOND_OK means that bytes were produced.
typedef enum wirebond_status {
  WIREBOND_OK,
  WIREBOND_OUT_OF_RANGE,  ///< a field is outside its range, not finite, or does not fit its wire type
  WIREBOND_TOO_SMALL,     ///< the caller's buffer cannot hold the frame
  WIREBOND_QUEUE_FULL,    ///< no room in the link's send queue now
  WIREBOND_LINK_DOWN      ///< the link has not started, or its port does not work
} wirebond_status_t;

/// Why received bytes were thrown away: the index into the arrays of wirebond_account_t.
typedef enum wirebond_cause {
  WIREBOND_NO_START,               ///< between frames: bytes that start nothing
  WIREBOND_CONSTANT_MISMATCH,      ///< a magic, constant or tail has another value
  WIREBOND_LENGTH_OUT_OF_RANGE,    ///< the length is more than max_payload, or negative
  WIREBOND_UNKNOWN_MESSAGE,        ///< `unknown: reject`: no such id, or a payload of another size
  WIREBOND_HEADER_CHECK_MISMATCH,  ///< a check over the header alone
  WIREBOND_CHECK_MISMATCH,         ///< a check that needs the whole frame
  WIREBOND_BAD_STUFFING,           ///< not a possible result of the stuffing
  WIREBOND_INCOMPLETE,             ///< the line fell silent inside it
  WIREBOND_CAUSE_COUNT
} wirebond_cause_t;

/// Where every received byte went. Modulo 2^32, and exact after every call:
/// bytes == frame_bytes + fill_bytes + pending_bytes + the sum of discarded_bytes.
typedef struct wirebond_account {
  uint32_t bytes;  ///< all that were fed
  uint32_t frame_bytes;
  uint32_t fill_bytes;     ///< delimiters between frames
  uint32_t pending_bytes;  ///< not settled yet
  uint32_t discarded_bytes[WIREBOND_CAUSE_COUNT];

  uint32_t frames;
  uint32_t unknown_frames;                             ///< of these: unknown id, or too short for the message
  uint32_t rejected_candidates[WIREBOND_CAUSE_COUNT];  ///< how often, where discarded_bytes says how much
} wirebond_account_t;

/// What the field rules find in one message, a bit each.
enum {
  WIREBOND_NOT_FINITE = 1,          ///< a float is NaN or infinite
  WIREBOND_UNKNOWN_ENUM = 2,        ///< an enum holds a value without a name
  WIREBOND_VALUE_OUT_OF_RANGE = 4,  ///< a number lies outside its range, and its rule is to reject
  WIREBOND_CLAMPED = 8,             ///< a number lies outside its range, and its rule is to clamp
  WIREBOND_WRONG_COUNT = 16         ///< a count tells more elements than there are, or than the protocol allows
};

/// Received messages that broke a field rule, modulo 2^32. One message may count under several kinds.
typedef struct wirebond_violations {
  uint32_t not_finite;
  uint32_t unknown_enum;
  uint32_t out_of_range;
  uint32_t clamped;
  uint32_t wrong_count;
  uint32_t rejected;  ///< messages that the handlers did not get
} wirebond_violations_t;

/// Intact messages that reached no function, by the reason, modulo 2^32. Their frames count as delivered.
typedef struct wirebond_not_acted {
  uint32_t late;       ///< as old as the shortest deadline of their message, or older, when they were found
  uint32_t held_back;  ///< a deadline of their message with `recover: explicit` had struck
} wirebond_not_acted_t;

/// Whom a message is for, where frames have an `address`.
typedef enum wirebond_addressee {
  WIREBOND_ADDRESSEE_OWN,     ///< this end alone: it may answer
  WIREBOND_ADDRESSEE_ALL,     ///< a broadcast: acted on, never answered
  WIREBOND_ADDRESSEE_ANOTHER  ///< another address: only who listens to all gets it
} wirebond_addressee_t;

/// What the sequence numbers of received frames told, modulo 2^32. A number is compared with the one before it.
typedef struct wirebond_sequence_counts {
  uint32_t numbered;  ///< frames whose number was looked at
  uint32_t gaps;      ///< frames that are missing
  uint32_t repeats;   ///< frames with the number of the frame before
  uint32_t restarts;  ///< jumps beyond half the range of numbers: the other end began again
} wirebond_sequence_counts_t;

/// A frame of no known message. Pointers are valid during the call that hands it out.
typedef struct wirebond_frame {
  const uint8_t* wire;  ///< as received, delimiters included
  size_t wire_size;
  const uint8_t* payload;
  size_t payload_size;
  uint32_t id;  ///< 0 where the format has none
} wirebond_frame_t;

/// Room for a receiver beside its workspace. The generated .cpp does not compile where that is too little.
#define WIREBOND_RECEIVER_BYTES(workspace) ((workspace) + 12 * sizeof(void*) + 36 * sizeof(uint32_t))
/// Room for this many deadlines.
#define WIREBOND_DEADLINES_BYTES(rules) (2 * sizeof(void*) + (rules)*5 * sizeof(uint32_t))

// ---- links ----------------------------------------------------------------------------------------------------------

/// What a port's status register said since somebody last asked. A flag says that there was one such byte or more.
typedef struct wirebond_line_errors {
  bool framing;  ///< no stop bit: another baud rate, a cable that was touched
  bool noise;    ///< samples of one bit disagree
  bool overrun;  ///< DMA did not fetch a byte in time, and it is lost
  bool parity;
} wirebond_line_errors_t;

/// A UART, as a link asks for it. Each function must be there but those at the end; `context` is given to each. A table
/// may be `const` and in flash, and outlives its link. "The interrupt" is that of the UART and those of its DMA, which
/// must have one priority, so that they never interrupt each other. Where there is none, whoever polls the link stands
/// for it.
///
/// In turn the interrupt calls the link: ..._link_on_received, _on_transmitted, _on_error and _on_pended.
typedef struct wirebond_port {
  void* context;
  /// Start circular reception into ring[0 .. size), or start it again at ring[0]. False: refused; the link tries again
  /// from its poll. The first poll, then the interrupt.
  bool (*start_receive)(void* context, uint8_t* ring, size_t size);
  /// Is reception under way? False where an error has stopped it. The interrupt.
  bool (*receiving)(void* context);
  /// Where in the ring DMA writes next: 0 .. size - 1, which is (size - NDTR) modulo size. Any task, any interrupt.
  size_t (*receive_position)(void* context);
  /// Start sending bytes[0 .. size); they stay valid until ..._on_transmitted. False: busy, or an error; the link
  /// offers the same bytes again from its poll. The interrupt.
  bool (*start_transmit)(void* context, const uint8_t* bytes, size_t size);
  /// Break off what `start_transmit` began; no transmit-complete event comes for it after this. The interrupt.
  void (*stop_transmit)(void* context);
  /// Let the UART's own interrupt run soon (NVIC_SetPendingIRQ); it then calls ..._on_pended. Any task, any interrupt;
  /// never blocks.
  void (*pend)(void* context);
  /// Can the UART's DMA reach all of bytes[0 .. size)? The link stays down where it cannot. From its poll.
  bool (*reaches)(void* context, const void* bytes, size_t size);

  // These may be left out.

  /// The clock that the poll is given, in microseconds. With it, received bytes are as old as the receive event before
  /// them; where it is NULL, as the poll before the one that found them. The interrupt.
  uint32_t (*now_us)(void* context);
  /// No DMA: your code moves each byte, and calls ..._on_received at least once in each turn of the ring. Then nothing
  /// is dropped for a poll that is late by more than the ring takes to fill.
  bool tells_every_lap;
  /// Is the UART set up as the link needs it, for this baud rate? WIREBOND_WHY_NOTHING, or what is wrong with it; for
  /// ..._link_why. From where that is called.
  wirebond_why_t (*check)(void* context, uint32_t baud);
  /// Where line errors do not end reception: what the UART's status says of them, which it forgets. The interrupt.
  wirebond_line_errors_t (*take_line_errors)(void* context);
  /// Does anybody read? False: no program has the port open (USB), a cable is off. Then the link is down, what waits
  /// expires, and ..._send_... answers WIREBOND_LINK_DOWN. The poll.
  bool (*connected)(void* context);
  /// End reception, because the link is down. The interrupt.
  void (*stop_receive)(void* context);
  /// All before this place of the ring is read: for a port that can make its sender wait. The poll.
  void (*read_to)(void* context, size_t place);
  /// The last run has left, and none follows it: where a pin enables a driver (RS-485), switch it off. `start_transmit`
  /// switches it on. The interrupt.
  void (*line_free)(void* context);
} wirebond_port_t;

/// How a link stands.
typedef enum wirebond_link_state {
  WIREBOND_STATE_DOWN,   ///< not polled yet, stopped, or its port does not work: nothing is sent or received
  WIREBOND_STATE_STALE,  ///< it runs, and no valid frame came for a second
  WIREBOND_STATE_UP      ///< valid frames come
} wirebond_link_state_t;

/// What is known of the file that the other end was built from.
typedef enum wirebond_peer {
  WIREBOND_PEER_UNKNOWN,   ///< it has not said hello
  WIREBOND_PEER_SAME,      ///< the same wire
  WIREBOND_PEER_DIFFERENT  ///< another protocol hash: its messages may mean something else
} wirebond_peer_t;

/// How severe a log line is.
typedef enum wirebond_level {
  WIREBOND_LEVEL_DEBUG,
  WIREBOND_LEVEL_INFO,
  WIREBOND_LEVEL_WARNING,
  WIREBOND_LEVEL_ERROR
} wirebond_level_t;

/// What happened to the line, the port and the polls, modulo 2^32.
typedef struct wirebond_link_counters {
  uint32_t line_errors;        ///< error events, and looks at the UART's status that found an error
  uint32_t framing_errors;     ///< of these looks, those that found this kind: 0 where the port does not look
  uint32_t noise_errors;       ///< the same
  uint32_t overruns;           ///< the same
  uint32_t parity_errors;      ///< the same
  uint32_t receive_restarts;   ///< reception was begun again, after an error or for silence
  uint32_t transmit_retries;   ///< the port did not take a run: busy, or an error
  uint32_t transmit_timeouts;  ///< a run did not leave in time, and was stopped
  uint32_t slow_polls;         ///< more than half the shortest deadline after the poll before
  uint32_t nested_polls;       ///< polls that found the UART's interrupt at work, and returned at once
  uint32_t unserved_pends;     ///< polls that found their last pend unserved, and pended again
  uint32_t late;        ///< messages as old as their shortest deadline when they were found: no function was called
  uint32_t held_back;   ///< messages held back by a deadline with `recover: explicit`: no function was called
  uint32_t foreign;     ///< frames for another address: no function was called
  uint32_t unlisted;    ///< frames of messages that the file does not list, where checks count a seed: else 0
  uint32_t echoed;      ///< own bytes that were heard back and dropped, where the file says `echo`: else 0
  uint32_t collisions;  ///< runs that were not heard back as they were sent, where the file says `echo`
} wirebond_link_counters_t;

/// Where every byte went that was handed out from the receive ring, as wirebond_account_t says it; a link does not
/// count the candidates that it rejects.
typedef struct wirebond_link_account {
  uint32_t bytes;
  uint32_t frame_bytes;
  uint32_t fill_bytes;
  uint32_t pending_bytes;
  uint32_t discarded_bytes[WIREBOND_CAUSE_COUNT];

  uint32_t frames;
  uint32_t unknown_frames;
} wirebond_link_account_t;

/// What became of the bytes that DMA wrote, modulo 2^32: received = handed_out + lapped + dropped + still unread.
typedef struct wirebond_receive_account {
  uint32_t received;    ///< bytes that DMA wrote into the ring
  uint32_t handed_out;  ///< of these, given to the receiver; its own account says where they went
  uint32_t lapped;      ///< of these, written over before they were read
  uint32_t laps;        ///< how often that happened
  uint32_t overtaken;   ///< handed out, and written over while they were read: the ring is too small
  uint32_t dropped;     ///< of `received`: not read, because more may have come than anybody could count
  /// How often there was no poll for as long as the ring takes to fill. Whole rings may have come that `received` does
  /// not know of; what was left of them is in `dropped`.
  uint32_t laps_unknown;
} wirebond_receive_account_t;

/// Why a frame was not accepted: the index into wirebond_send_account_t::refused_by.
typedef enum wirebond_refusal {
  WIREBOND_REFUSED_NONE,       ///< stays 0
  WIREBOND_REFUSED_FULL,       ///< no room, because finished frames wait for the line
  WIREBOND_REFUSED_HELD,       ///< no room, because frames that left lie behind one that its sender has not finished
  WIREBOND_REFUSED_RANGE,      ///< a field was out of range
  WIREBOND_REFUSED_DOWN,       ///< the link was down
  WIREBOND_REFUSED_ABANDONED,  ///< its sender gave its room back
  WIREBOND_REFUSAL_COUNT
} wirebond_refusal_t;

/// What became of each frame that somebody wanted to send, modulo 2^32. Exact while no sender is inside a call:
/// offered == accepted + unfinished + the sum of refused_by;
/// accepted == sent + queued + replaced + expired + aborted.
typedef struct wirebond_send_account {
  uint32_t offered;
  uint32_t accepted;
  uint32_t refused_by[WIREBOND_REFUSAL_COUNT];
  uint32_t sent;
  uint32_t replaced;    ///< by a newer frame of a message of `queue: latest`
  uint32_t expired;     ///< waited for longer than the file's `max_age`
  uint32_t aborted;     ///< in a run that was stopped; some of its frames may have arrived
  uint32_t queued;      ///< finished and not gone, now
  uint32_t unfinished;  ///< being written by their senders, now
} wirebond_send_account_t;

/// One parameter's range and its first value.
typedef struct wirebond_parameter_rule {
  float least;
  float most;
  float initial;
} wirebond_parameter_rule_t;

/// The parameters that the host may read and set. An index is a place in both arrays, which are yours and outlive the
/// link. Opening the link writes each `initial` to `values`; what the host sets is written there inside the link's
/// poll, one word at a time, so that other tasks may read it.
typedef struct wirebond_parameters {
  const wirebond_parameter_rule_t* rules;
  float* values;
  size_t count;  ///< of both; 0: there are none
} wirebond_parameters_t;

#ifdef __cplusplus
}
#endif

#endif
