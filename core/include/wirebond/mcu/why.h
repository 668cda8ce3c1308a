// Reasons why a link at the MCU may not work, and a sentence for each. C99, C11 and C++; it queries nothing and knows
// no link.
#ifndef WIREBOND_WHY_H
#define WIREBOND_WHY_H

#ifdef __cplusplus
extern "C" {
#endif

/// Why a link does not work as it should. A link reports the first of these that holds, in this order.
typedef enum wirebond_why {
  WIREBOND_WHY_NOTHING,                   ///< nothing is known to be wrong
  WIREBOND_WHY_NOT_POLLED,                ///< its poll was never called
  WIREBOND_WHY_BUFFERS_UNREACHABLE,       ///< DMA cannot reach its buffers
  WIREBOND_WHY_UART_NOT_SET_UP,           ///< by the port: the UART is not initialised
  WIREBOND_WHY_NO_RECEIVE_DMA,            ///< by the port: no DMA for receiving
  WIREBOND_WHY_NO_TRANSMIT_DMA,           ///< by the port: no DMA for sending
  WIREBOND_WHY_RECEIVE_DMA_NOT_CIRCULAR,  ///< by the port: DMA stops at the end of the ring
  WIREBOND_WHY_BAUD_DIFFERS,              ///< by the port: another baud rate than the file's
  WIREBOND_WHY_INTERRUPT_OFF,             ///< by the port: the UART's interrupt is not enabled
  WIREBOND_WHY_NOT_CONNECTED,             ///< the port says that no program reads, or it is stopped
  WIREBOND_WHY_PORT_REFUSES,              ///< the port does not start reception
  WIREBOND_WHY_PENDS_UNSERVED,            ///< the interrupt was pended, but `on_pended` was never called
  WIREBOND_WHY_RECEPTION_STOPS,           ///< reception ends without an error event
  WIREBOND_WHY_RUNS_NOT_COMPLETED,        ///< DMA takes no run, or what it took never ends
  WIREBOND_WHY_NO_ECHO,                   ///< `echo: true`, but nothing that was sent came back
  WIREBOND_WHY_WRONG_TIME_BASE,           ///< the poll's time passes too slowly: it does not count microseconds
  WIREBOND_WHY_HEARS_ITSELF,              ///< own frames come back, but the file does not say `echo: true`
  WIREBOND_WHY_NOTHING_UNDERSTOOD,        ///< bytes or line errors came, but never a frame
  WIREBOND_WHY_NOTHING_HEARD,             ///< no valid frame came for a second, or none yet
  WIREBOND_WHY_PROTOCOL_DIFFERS,          ///< the host has another protocol file, so its commands do not act
  WIREBOND_WHY_MANY_LINE_ERRORS,          ///< frames come, but more than one error in 1000 bytes
  WIREBOND_WHY_MANY_COLLISIONS,           ///< `echo: true`, but more than one run in 100 did not come back as sent
  WIREBOND_WHY_SLOW_WITHOUT_CLOCK,        ///< polls came late, and without a clock at the port commands may act late
  WIREBOND_WHY_POLLED_TOO_SELDOM,         ///< received bytes were lost between two polls
  WIREBOND_WHY_CLOCK_STEPS_BACK,          ///< the poll's time has stepped back
  WIREBOND_WHY_TICK_BELOW_UART,           ///< by the port: the vendor's tick cannot interrupt the UART's interrupt
  WIREBOND_WHY_COUNT
} wirebond_why_t;

/// Return a sentence that says what is wrong and what to do. Takes flash only if it is called.
static inline const char* wirebond_why_text(wirebond_why_t why) {
  switch (why) {
    case WIREBOND_WHY_NOTHING: return "nothing is known to be wrong";
    case WIREBOND_WHY_NOT_POLLED: return "the link's poll was never called: call it every millisecond or two";
    case WIREBOND_WHY_BUFFERS_UNREACHABLE:
      return "DMA cannot reach the link's buffers: put them into memory that it reaches (not into CCM or DTCM)";
    case WIREBOND_WHY_UART_NOT_SET_UP:
      return "the UART is not initialised: call MX_..._UART_Init() before the link's first poll";
    case WIREBOND_WHY_NO_RECEIVE_DMA:
      return "the UART has no receive DMA: add it in its DMA settings, and call MX_DMA_Init() before the UART's init";
    case WIREBOND_WHY_NO_TRANSMIT_DMA:
      return "the UART has no transmit DMA: add it in its DMA settings, and call MX_DMA_Init() before the UART's init";
    case WIREBOND_WHY_RECEIVE_DMA_NOT_CIRCULAR: return "the receive DMA is in normal mode: set its mode to circular";
    case WIREBOND_WHY_BAUD_DIFFERS:
      return "the UART has another baud rate than `link: baud` of the protocol file: make them equal";
    case WIREBOND_WHY_INTERRUPT_OFF: return "the UART's interrupt is off: enable its global interrupt in the NVIC";
    case WIREBOND_WHY_NOT_CONNECTED:
      return "the other end is not there: no program has the port open (DTR), the cable is off, or the port is stopped";
    case WIREBOND_WHY_PORT_REFUSES:
      return "the port does not start reception: is the UART initialised, and used by nothing else?";
    case WIREBOND_WHY_PENDS_UNSERVED:
      return "the UART's interrupt was pended and `on_pended` was not called: call it in the UART's interrupt handler, "
             "and enable that interrupt";
    case WIREBOND_WHY_RECEPTION_STOPS:
      return "reception ends by itself: set the receive DMA to circular mode, and call `on_error` in the error "
             "callback";
    case WIREBOND_WHY_RUNS_NOT_COMPLETED:
      return "nothing that is sent leaves: has the UART a transmit DMA in normal mode? Call `on_transmitted` in the "
             "transmit-complete callback, and enable the interrupts of the UART and of its transmit DMA";
    case WIREBOND_WHY_NO_ECHO:
      return "nothing that is sent comes back, and the protocol file says `echo: true`: is the transceiver's driver "
             "enabled while this end sends, and its receiver always? Without an echo, remove that line";
    case WIREBOND_WHY_WRONG_TIME_BASE:
      return "the time that the poll is given passes too slowly: the port's clock or tick passes faster, or more bytes "
             "come than `link: baud` of the protocol file allows in that time. Deadlines strike late, or never. The "
             "poll takes microseconds: give milliseconds, as of HAL_GetTick(), to poll_ms; and compare the baud rates";
    case WIREBOND_WHY_HEARS_ITSELF:
      return "this end receives its own bytes, as an echo: is TX shorted to RX? On RS-485 or one wire write "
             "`echo: true` under `link` of the protocol file, or switch the receiver off while this end sends";
    case WIREBOND_WHY_NOTHING_UNDERSTOOD:
      return "bytes come, and no frame is among them: compare baud rate, parity, stop bits and protocol file of both "
             "ends; and see that TX is not shorted to RX";
    case WIREBOND_WHY_NOTHING_HEARD:
      return "no valid frame comes: is the other end on, its TX at this RX, with a common ground?";
    case WIREBOND_WHY_PROTOCOL_DIFFERS:
      return "the host said hello with another protocol hash, so its commands do not act, but for the emergency stop: "
             "build both ends from one file (`wirebond diff` compares two), or write `on_mismatch: act` under `link`";
    case WIREBOND_WHY_MANY_LINE_ERRORS:
      return "frames come, and many bytes have errors: the counters say which kind. Framing: baud rate, ground, cable; "
             "noise: use one sample for each bit; overrun: give the receive DMA the highest priority";
    case WIREBOND_WHY_MANY_COLLISIONS:
      return "sent bytes often come back altered: two ends send at the same time, or the line is disturbed. Let "
             "only one end begin, and the others answer";
    case WIREBOND_WHY_SLOW_WITHOUT_CLOCK:
      return "a poll came later than half the shortest deadline, and the port has no clock: a command that waits for a "
             "slow handler acts late, and `late` does not count it. Give the port a clock (`now_us`), and keep slow "
             "work, such as erasing flash, out of handlers";
    case WIREBOND_WHY_POLLED_TOO_SELDOM:
      return "the receive ring overflows between two polls, and received bytes are lost: poll more often, or enlarge "
             "the ring to twice the bytes that can arrive between two polls";
    case WIREBOND_WHY_CLOCK_STEPS_BACK:
      return "the time that the poll is given has stepped back: a clock that is put together from a tick and a timer "
             "reads both again until the tick is the same, and all polls of a link have one clock";
    case WIREBOND_WHY_TICK_BELOW_UART:
      return "the HAL's tick cannot interrupt the UART's interrupt, which may then wait for it for ever: give the tick "
             "a higher priority (a lower number) than the UART";
    case WIREBOND_WHY_COUNT: break;
  }
  return "not a reason";
}

#ifdef __cplusplus
}
#endif

#endif
