/** How a page names a port: the standard gives it no more than the ids of a USB device. */
export function portName({ usbVendorId, usbProductId }: SerialPortInfo): string {
  const digits = (id: number) => id.toString(16).padStart(4, "0");
  return usbVendorId === undefined ? "serial port" : `usb:${digits(usbVendorId)}:${digits(usbProductId ?? 0)}`;
}
