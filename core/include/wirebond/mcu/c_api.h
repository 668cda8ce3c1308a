// Common part of the C headers of all protocols: results, counters, frames, a link's port. C99, C11 and C++; contains
// no function.
#ifndef WIREBOND_C_API_H
#define WIREBOND_C_API_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Relative to this file: C sources may be compiled without an include folder.
#include "why.h"

/// Marks a function whose result may mean that nothing was done: GCC and Clang warn if it is ignored. A cast to `void`
/// does not help with GCC. Check it even if there is nothing to do:
///     if (..._send_status(link, &status) != WIREBOND_OK) { /* the link has counted it; the next one is due soon */ }
#if defined(__GNUC__)
#define WIREBOND_MUST_CHECK __attribute__((warn_unused_result))
#else
#define WIREBOND_MUST_CHECK
#endif

#ifdef __cplusplus
extern "C" {
#endif

/// Result of an encode or a send. Only WIREBOND_OK means that bytes were produced.
typedef enum wirebond_status {
  WIREBOND_OK,
  WIREBOND_OUT_OF_RANGE,  ///< a field is outside its range, not finite, or does not fit its wire type
  WIREBOND_TOO_SMALL,     ///< the caller's buffer cannot hold the frame
  WIREBOND_QUEUE_FULL,    ///< the link's send queue is full now
  WIREBOND_LINK_DOWN      ///< the link has not started, or its port does not work
} wirebond_status_t;

/// Why received bytes were discarded: the index into the arrays of wirebond_account_t.
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
///     bytes == frame_bytes + fill_bytes + pending_bytes + the sum of discarded_bytes
typedef struct wirebond_account {
  uint32_t bytes;  ///< all that were fed
  uint32_t frame_bytes;
  uint32_t fill_bytes;     ///< delimiters between frames
  uint32_t pending_bytes;  ///< not settled yet
  uint32_t discarded_bytes[WIREBOND_CAUSE_COUNT];

  uint32_t frames;
  uint32_t unknown_frames;                             ///< of these: unknown id, or too short for the message
  uint32_t rejected_candidates[WIREBOND_CAUSE_COUNT];  ///< how often, where discarded_bytes counts bytes
} wirebond_account_t;

/// Violations found in one message, a bit each.
enum {
  WIREBOND_NOT_FINITE = 1,          ///< a float is NaN or infinite
  WIREBOND_UNKNOWN_ENUM = 2,        ///< an enum has a value without a name
  WIREBOND_VALUE_OUT_OF_RANGE = 4,  ///< a number is out of its range, and its rule is to reject
  WIREBOND_CLAMPED = 8,             ///< a number is out of its range, and its rule is to clamp
  WIREBOND_WRONG_COUNT = 16  ///< a count is larger than the number of elements received, or than the protocol allows
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

/// Intact messages that reached no function, by reason, modulo 2^32. Their frames count as delivered.
typedef struct wirebond_not_acted {
  uint32_t late;       ///< as old as the shortest deadline of their message, or older, when they were found
  uint32_t held_back;  ///< a deadline of their message with `recover: explicit` had struck
} wirebond_not_acted_t;

/// The receiver of a message, where frames have an `address`.
typedef enum wirebond_addressee {
  WIREBOND_ADDRESSEE_OWN,     ///< this end alone: it may answer
  WIREBOND_ADDRESSEE_ALL,     ///< a broadcast: acted on, never answered
  WIREBOND_ADDRESSEE_ANOTHER  ///< another address: only an end that listens to all gets it
} wirebond_addressee_t;

/// Counts from the sequence numbers of received frames, modulo 2^32. A number is compared with the one before it.
typedef struct wirebond_sequence_counts {
  uint32_t numbered;  ///< frames whose number was compared
  uint32_t gaps;      ///< missing frames
  uint32_t repeats;   ///< frames with the number of the frame before
  uint32_t restarts;  ///< jumps beyond half the range of numbers: the other end restarted
} wirebond_sequence_counts_t;

/// A frame of no known message. Pointers are valid only during the call that passes it.
typedef struct wirebond_frame {
  const uint8_t* wire;  ///< as received, delimiters included
  size_t wire_size;
  const uint8_t* payload;
  size_t payload_size;
  uint32_t id;  ///< 0 if the format has none
} wirebond_frame_t;

/// Memory for a receiver beside its workspace. The generated .cpp does not compile if that is too little.
#define WIREBOND_RECEIVER_BYTES(workspace) ((workspace) + 12 * sizeof(void*) + 36 * sizeof(uint32_t))
/// Memory for this many deadlines.
#define WIREBOND_DEADLINES_BYTES(rules) (2 * sizeof(void*) + (rules)*5 * sizeof(uint32_t))

// ---- links ----------------------------------------------------------------------------------------------------------

/// Errors in a port's status register since the last query. A flag means one or more such bytes.
typedef struct wirebond_line_errors {
  bool framing;  ///< no stop bit: another baud rate, or a disturbed cable
  bool noise;    ///< samples of one bit disagree
  bool overrun;  ///< DMA did not fetch a byte in time, so it is lost
  bool parity;
} wirebond_line_errors_t;

/// A UART, as a link uses it. Each function is required, except those at the end; `context` is passed to each. A table
/// may be `const` and in flash, and must outlive its link. "The interrupt" is that of the UART and those of its DMA,
/// which must have one priority, so that they never interrupt each other. Without one, the context that polls the link
/// replaces it.
///
/// The interrupt calls the link in return: ..._link_on_received, _on_transmitted, _on_error and _on_pended.
typedef struct wirebond_port {
  void* context;
  /// Start circular reception into ring[0 .. size), or restart it at ring[0]. Return false if refused; the link tries
  /// again from its poll. Called by the first poll, then by the interrupt.
  bool (*start_receive)(void* context, uint8_t* ring, size_t size);
  /// Return whether reception is running; false if an error has stopped it. The interrupt.
  bool (*receiving)(void* context);
  /// Return where in the ring DMA writes next: 0 .. size - 1, which is (size - NDTR) modulo size. Any task, any
  /// interrupt.
  size_t (*receive_position)(void* context);
  /// Start sending bytes[0 .. size); they stay valid until ..._on_transmitted. Return false if busy, or on an error;
  /// the link offers the same bytes again from its poll. The interrupt.
  bool (*start_transmit)(void* context, const uint8_t* bytes, size_t size);
  /// Abort what `start_transmit` began; no transmit-complete event may come for it after this. The interrupt.
  void (*stop_transmit)(void* context);
  /// Let the UART's own interrupt run soon (NVIC_SetPendingIRQ); it then calls ..._on_pended. Any task, any interrupt;
  /// must not block.
  void (*pend)(void* context);
  /// Return whether the UART's DMA can reach all of bytes[0 .. size). If not, the link stays down. Its poll.
  bool (*reaches)(void* context, const void* bytes, size_t size);

  // The rest is optional.

  /// Return the time of the clock that is passed to the poll, in microseconds. With it, received bytes are as old as
  /// the receive event before them; if it is NULL, as the poll before the one that found them. The interrupt.
  uint32_t (*now_us)(void* context);
  /// No DMA: your code moves each byte, and calls ..._on_received at least once per turn of the ring. Then nothing is
  /// dropped if a poll is late by more than the ring takes to fill.
  bool tells_every_lap;
  /// Check whether the UART is set up as the link needs it, for this baud rate: return WIREBOND_WHY_NOTHING, or the
  /// fault; for ..._link_why. The context that calls that.
  wirebond_why_t (*check)(void* context, uint32_t baud);
  /// If line errors do not end reception: return the errors in the UART's status, and clear them. The interrupt.
  wirebond_line_errors_t (*take_line_errors)(void* context);
  /// Return whether somebody reads; false if no program has the port open (USB), or a cable is unplugged. Then the link
  /// is down, waiting frames expire, and ..._send_... returns WIREBOND_LINK_DOWN. The poll.
  bool (*connected)(void* context);
  /// End reception, because the link is down. The interrupt.
  void (*stop_receive)(void* context);
  /// Note that all bytes before this place of the ring are read: for a port that can make its sender wait. The poll.
  void (*read_to)(void* context, size_t place);
  /// Switch off the driver, if a pin enables one (RS-485): the last run has left, and none follows it. `start_transmit`
  /// switches it on. The interrupt.
  void (*line_free)(void* context);
  /// Return the time of another clock, in milliseconds, such as the tick of the vendor's library: ..._link_why compares
  /// it with the time passed to the poll, which may pass too slowly. It may stop at times. The poll.
  uint32_t (*tick_ms)(void* context);
  /// Bytes may come faster than the file's `link: baud`, as over USB.
  bool is_unpaced;
} wirebond_port_t;

/// State of a link.
typedef enum wirebond_link_state {
  WIREBOND_STATE_DOWN,   ///< not polled yet, stopped, or its port does not work: nothing is sent or received
  WIREBOND_STATE_STALE,  ///< it runs, but no valid frame came for a second
  WIREBOND_STATE_UP      ///< valid frames come
} wirebond_link_state_t;

/// Knowledge about the protocol file of the other end.
typedef enum wirebond_peer {
  WIREBOND_PEER_UNKNOWN,   ///< it has not said hello
  WIREBOND_PEER_SAME,      ///< the same wire
  WIREBOND_PEER_DIFFERENT  ///< another protocol hash: its messages may mean something else
} wirebond_peer_t;

/// Severity of a log line.
typedef enum wirebond_level {
  WIREBOND_LEVEL_DEBUG,
  WIREBOND_LEVEL_INFO,
  WIREBOND_LEVEL_WARNING,
  WIREBOND_LEVEL_ERROR
} wirebond_level_t;

/// Events of the line, the port and the polls, modulo 2^32.
typedef struct wirebond_link_counters {
  uint32_t line_errors;        ///< error events, and queries of the UART's status that found an error
  uint32_t framing_errors;     ///< queries that found this kind; 0 if the port does not query
  uint32_t noise_errors;       ///< see framing_errors
  uint32_t overruns;           ///< see framing_errors
  uint32_t parity_errors;      ///< see framing_errors
  uint32_t receive_restarts;   ///< of reception: after an error, after silence or because it had stopped
  uint32_t reception_stops;    ///< of these, reception that had ended without an error event
  uint32_t transmit_retries;   ///< the port did not take a run: busy, or an error
  uint32_t transmit_timeouts;  ///< a run did not leave in time, and was aborted
  uint32_t slow_polls;         ///< polls more than half the shortest deadline after the one before
  uint32_t nested_polls;       ///< polls that found the UART's interrupt or another poll running, and returned
  uint32_t unserved_pends;     ///< polls that found their last pend unserved, and pended again
  uint32_t late;         ///< messages as old as their shortest deadline when they were found: no function was called
  uint32_t held_back;    ///< messages held back by a deadline with `recover: explicit`: no function was called
  uint32_t foreign;      ///< frames for another address: no function was called
  uint32_t unlisted;     ///< frames of messages not in the file, where checks count a seed; otherwise 0
  uint32_t echoed;       ///< own bytes that were heard back and dropped, if the file says `echo`; otherwise 0
  uint32_t collisions;   ///< runs that were not heard back as they were sent, if the file says `echo`
  uint32_t clock_steps;  ///< polls whose time was before that of the poll before
  uint32_t own_frames;   ///< own frames that came back, or frames equal to them, if the file has no `echo`
} wirebond_link_counters_t;

/// Where every byte from the receive ring went, as in wirebond_account_t; a link does not count the candidates that it
/// rejects.
typedef struct wirebond_link_account {
  uint32_t bytes;
  uint32_t frame_bytes;
  uint32_t fill_bytes;
  uint32_t pending_bytes;
  uint32_t discarded_bytes[WIREBOND_CAUSE_COUNT];

  uint32_t frames;
  uint32_t unknown_frames;
} wirebond_link_account_t;

/// Account of the bytes that DMA wrote, modulo 2^32: received = handed_out + lapped + dropped + unread.
typedef struct wirebond_receive_account {
  uint32_t received;    ///< bytes that DMA wrote into the ring
  uint32_t handed_out;  ///< given to the receiver; its own account says where they went
  uint32_t lapped;      ///< overwritten before they were read
  uint32_t laps;        ///< how often that happened
  uint32_t overtaken;   ///< handed out, but overwritten while they were read: the ring is too small
  uint32_t dropped;     ///< not read, because an unknown number of bytes may have come
  /// How often no poll came for as long as the ring takes to fill. Whole rings may have come then that `received` does
  /// not count; the rest of them is counted in `dropped`.
  uint32_t laps_unknown;
} wirebond_receive_account_t;

/// Why a frame was not accepted: the index into wirebond_send_account_t::refused_by.
typedef enum wirebond_refusal {
  WIREBOND_REFUSED_NONE,       ///< stays 0
  WIREBOND_REFUSED_FULL,       ///< no free memory, because finished frames wait for the line
  WIREBOND_REFUSED_HELD,       ///< no free memory, because an unfinished frame is before frames that have left
  WIREBOND_REFUSED_RANGE,      ///< a field was out of range
  WIREBOND_REFUSED_DOWN,       ///< the link was down
  WIREBOND_REFUSED_ABANDONED,  ///< its sender gave its memory back
  WIREBOND_REFUSAL_COUNT
} wirebond_refusal_t;

/// Counts the outcome of each frame offered for sending, modulo 2^32. Exact while no sender is inside a call:
///     offered  == accepted + unfinished + the sum of refused_by
///     accepted == sent + queued + replaced + expired + aborted
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

/// One parameter's range and its initial value.
typedef struct wirebond_parameter_rule {
  float least;
  float most;
  float initial;
} wirebond_parameter_rule_t;

/// The parameters that the host may read and set. An index is a place in both arrays, which you own and which must
/// outlive the link. Opening the link writes each `initial` to `values`; values set by the host are written there
/// inside the link's poll, one word at a time, so that other tasks may read them.
typedef struct wirebond_parameters {
  const wirebond_parameter_rule_t* rules;
  float* values;
  size_t count;  ///< of both; 0: there are none
} wirebond_parameters_t;

#ifdef __cplusplus
}
#endif

#endif
