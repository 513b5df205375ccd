// Sensors that the browser reads: a board by Web Serial or Web Bluetooth, and the phone's own. They send
// lines like a board on a serial port, and the server parses them in the same way.

const BAUD = 115_200;
const UART = "6e400001-b5a3-f393-e0a9-e50e24dcca9e", UART_NOTIFY = "6e400003-b5a3-f393-e0a9-e50e24dcca9e";
const PHONE_HZ = 60, HEADER_MS = 10_000;
const STANDARD_GRAVITY = 9.80665, DEG_PER_RAD = 180 / Math.PI;
const HEADER = "# device: phone\ntime_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps\n";

export const SENSORS = {
  phone: { isThere: () => "Accelerometer" in window && "Gyroscope" in window, open: openPhone },
  serial: { isThere: () => "serial" in navigator, open: openSerial },
  bluetooth: { isThere: () => "bluetooth" in navigator, open: openBluetooth },
};

// The Generic Sensor API has a right-handed frame and known units. Motion events of other browsers are not
// used, because their axes differ in sign and order.
async function openPhone(send, fail) {
  const accelerometer = new Accelerometer({ frequency: PHONE_HZ }), gyroscope = new Gyroscope({ frequency: PHONE_HZ });
  const encoder = new TextEncoder();
  let counter = 0, headerAt = -Infinity;
  accelerometer.addEventListener("reading", () => {
    if (!gyroscope.hasReading) return;
    const acc = [accelerometer.x, accelerometer.y, accelerometer.z].map((value) => (value / STANDARD_GRAVITY).toFixed(6));
    const gyr = [gyroscope.x, gyroscope.y, gyroscope.z].map((value) => (value * DEG_PER_RAD).toFixed(4));
    const isDue = accelerometer.timestamp - headerAt > HEADER_MS;
    if (isDue) headerAt = accelerometer.timestamp;
    const row = [Math.round(accelerometer.timestamp * 1000), counter++, ...acc, ...gyr].join(",");
    send(encoder.encode(`${isDue ? HEADER : ""}${row}\n`));
  });
  for (const sensor of [accelerometer, gyroscope]) sensor.addEventListener("error", (event) => fail(event.error));
  gyroscope.start();
  accelerometer.start();
  return { name: "phone", close: () => (accelerometer.stop(), gyroscope.stop()) };
}

async function openSerial(send, fail) {
  const port = await navigator.serial.requestPort();
  await port.open({ baudRate: BAUD });
  const reader = port.readable.getReader();
  const pump = async () => {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      send(value);
    }
  };
  pump().catch(fail);
  return { name: "serial", close: async () => (await reader.cancel(), reader.releaseLock(), port.close()) };
}

async function openBluetooth(send, fail) {
  const device = await navigator.bluetooth.requestDevice({ filters: [{ services: [UART] }] });
  const subscribe = async () => {
    const service = await (await device.gatt.connect()).getPrimaryService(UART);
    const lines = await service.getCharacteristic(UART_NOTIFY);
    lines.addEventListener("characteristicvaluechanged", (event) => send(new Uint8Array(event.target.value.buffer)));
    await lines.startNotifications();
  };
  await subscribe();
  const again = () => subscribe().catch(fail);
  device.addEventListener("gattserverdisconnected", again);
  return { name: device.name ?? "bluetooth", close: () => (device.removeEventListener("gattserverdisconnected", again), device.gatt.disconnect()) };
}
