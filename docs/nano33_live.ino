// Arduino Nano 33 BLE Sense (first revision, LSM9DS1): raw registers as lines for `acromion live /dev/ttyACM0`.
// 119 Hz, 16 g, 2000 deg/s at 70 mdps for a count (not 2000/32768). It compiles against Arduino's core
// interface and for AVR; it was not compiled by the Nano's own tool chain, nor run on a board.

#include <Wire.h>

const uint8_t SENSOR = 0x6B, WHO_AM_I = 0x0F, CTRL_REG1_G = 0x10, STATUS = 0x17, OUT_G = 0x18;
const uint8_t CTRL_REG6_XL = 0x20, CTRL_REG8 = 0x22, OUT_XL = 0x28;
const float G_PER_COUNT = 0.000732f, DPS_PER_COUNT = 0.070f;
const unsigned long HEADER_MS = 10000;  // for who listens later, the header comes again

unsigned long counter = 0, headerAt = 0;

void writeRegister(uint8_t where, uint8_t value) {
  Wire1.beginTransmission(SENSOR);
  Wire1.write(where);
  Wire1.write(value);
  Wire1.endTransmission();
}

bool readRegisters(uint8_t where, uint8_t *into, uint8_t count) {
  Wire1.beginTransmission(SENSOR);
  Wire1.write(where);
  if (Wire1.endTransmission(false) != 0 || Wire1.requestFrom(SENSOR, count) != count) return false;
  for (uint8_t k = 0; k < count; k++) into[k] = Wire1.read();
  return true;
}

void writeHeader() {
  Serial.println("# device: LSM9DS1");
  Serial.println("# acc_range_g: 16");
  Serial.println("# gyr_range_dps: 2000");
  Serial.println("time_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps");
  headerAt = millis();
}

void setup() {
  Serial.begin(115200);
  while (!Serial) {}
  Wire1.begin();
  Wire1.setClock(400000);
  writeRegister(CTRL_REG8, 0x44);     // a sample is read whole; addresses count up
  writeRegister(CTRL_REG1_G, 0x78);   // gyroscope 119 Hz, 2000 deg/s
  writeRegister(CTRL_REG6_XL, 0x68);  // accelerometer 119 Hz, 16 g
  writeHeader();
}

void loop() {
  uint8_t status = 0, bytes[12];
  if (!readRegisters(STATUS, &status, 1) || (status & 0x03) != 0x03) return;
  unsigned long now = micros();
  if (!readRegisters(OUT_G, bytes, 6) || !readRegisters(OUT_XL, bytes + 6, 6)) {
    counter++;  // a sample that could not be read is lost, and shows as such
    return;
  }
  int16_t counts[6];
  for (uint8_t k = 0; k < 6; k++) counts[k] = (int16_t)(bytes[2 * k] | (bytes[2 * k + 1] << 8));
  Serial.print(now);
  Serial.print(',');
  Serial.print(counter++);
  for (uint8_t k = 0; k < 6; k++) {
    bool isAcceleration = k < 3;
    uint8_t axis = k % 3;
    float value = counts[isAcceleration ? 3 + axis : axis] * (isAcceleration ? G_PER_COUNT : DPS_PER_COUNT);
    Serial.print(',');
    Serial.print(axis == 0 ? -value : value, isAcceleration ? 6 : 3);  // left-handed: x of both is turned
  }
  Serial.println();
  if (millis() - headerAt > HEADER_MS) writeHeader();
}
