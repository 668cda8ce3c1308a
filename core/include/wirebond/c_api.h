// What the C headers of all protocols share: answers, counters, frames. C99, C11 and C++; no function lives here.
#ifndef WIREBOND_C_API_H
#define WIREBOND_C_API_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define WIREBOND_MUST_CHECK __attribute__((warn_unused_result))
#else
#define WIREBOND_MUST_CHECK
#endif

#ifdef __cplusplus
extern "C" {
#endif

/// What became of an encode. Only WIREBOND_OK means that bytes were produced.
typedef enum wirebond_status {
  WIREBOND_OK,
  WIREBOND_OUT_OF_RANGE,  ///< a field is outside its range, not finite, or does not fit its wire type
  WIREBOND_TOO_SMALL      ///< the caller's buffer cannot hold the frame
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
/// Room for so many deadlines.
#define WIREBOND_DEADLINES_BYTES(rules) (2 * sizeof(void*) + (rules)*5 * sizeof(uint32_t))

#ifdef __cplusplus
}
#endif

#endif
