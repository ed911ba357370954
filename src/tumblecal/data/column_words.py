"""The words of column names: quantities, processing states and units, in the languages that loggers use.

They are in small letters; a word that is listed twice has its first meaning.
"""

# Quantities, and words that decide between them. `other` is not a reading: a count, an uncertainty, a set point.
MEANINGS = {
    "acceleration": (
        "ac acc accs accl acce accel accelero accelerometer accelerometers acceleration accelerations gf "
        "gforce xl specificforce beschleunigung beschleunigungssensor beschl aceleracion acelerometro "
        "acel accelerometre accelerazione accelerometro aceleracao versnelling acceleratie "
        "versnellingsmeter ivme przyspieszenie zrychleni kiihtyvyys gyorsulas 加速度 加速度计 加速度計 加速 ускорение "
        "акселерометр 가속도 adxl mma bma kxtj lis"
    ),
    "rate": (
        "ジャイロ gyr gyrs gyro gyros gyroscope gyroscopes omega drehrate winkelgeschwindigkeit giro "
        "giroscopio giroscopo gyroskop hoeksnelheid 角速度 陀螺仪 陀螺 гироскоп 자이로 itg bmg fxas"
    ),
    "field": (
        "地磁気 地磁 mag mags magn magnet magneto magnetic magnetometer magnetometers magfield compass "
        "magnetfeld magnetisch magnetfeldstarke magnetometro magnetique magnetico 磁场 磁場 磁力计 магнитометр "
        "hmc qmc ak bmm mdl"
    ),
    "orientation": (
        "quat quaternion quaternions orientation attitude euler roll pitch yaw azimuth heading course "
        "angle angles tilt rpy inclination lage winkel angulo rotvec rotationvector matrix dcm mat 角度 姿态 "
        "四元数"
    ),
    "gravity": "gravity grav schwerkraft gravedad gravite 重力",
    "velocity": "vel velocity velocities speed speeds geschwindigkeit velocidad vitesse velocita twist",
    "place": (
        "pos position latitude longitude lat lon lng alt altitude height location gps gnss east north northing easting"
    ),
    "time": (
        "sec secs second time times timestamp timestamps zeit zeitstempel tiempo temps tempo tijd stamp "
        "epoch epoc clock datetime elapsed seconds millis micros nanos ms us ns ts tick ticks tow now "
        "gpst msec usec nsec msecs usecs nsecs hour hours minute minutes 时间 時間 時刻 日時 время 시간 czas hora heure"
    ),
    "temperature": "temp temps temperature temperatures temperatur temperatura tmp 温度 температура 온도",
    "other": (
        "covariance convariance cov variance var std stdev stddev sd sigma error err bias offset accuracy "
        "status valid clip clipping count counter seq sequence integral derivative jerk setpoint target "
        "desired cmd command max min peak rms range fs threshold increment inc delta residual uncertainty "
        "pressure baro barometer druck hpa humidity light lux sound battery voltage current motor servo "
        "rc pid debug force torque emg ecg ppg gsr heart altimeter flow date id axisp axisi axisd axisf "
        "displacement norm abs absolute magnitude loop iteration frame index packet dt interval period latency"
    ),
    # These words decide only together with a second word.
    "angular": "angular ang winkelig angulaire angolare",
    "rotation": "rotation rot rotational turn drehung",
    "rate_of": "rate rates",
    "specific": "specific",
    "linear": "線形 线性 lin linear lineare lineaire lineal la lacc linacc laccel",
    "free": "free user ua uacc useracc dynamic highpass hpf hp nograv gravityfree",
    "with": "including incl includes with total",
    "without": "without no minus removed excluding excl less non free",
    "world": "world earth ned enu global navigation nav",
    "raw": "raw uncal uncalibrated uncomp uncompensated unfilt unfiltered adc",
    "processed": (
        "smooth smoothed filt filtered filter lpf lowpass lp cal calib calibrated corrected corr comp "
        "compensated avg average averaged fused est estimated ema butter kalman"
    ),
    # These words do not concern the quantity.
    "plain": (
        "out 轴 軸 方向 richtung direction dir val imu sensor sensors data axis component field header msg "
        "message value values signal body device since start started boot reboot begin unix utc system "
        "local sample samples sampling fine coarse logging log host of the in from relative to recorded "
        "received measurement motion motionsensor achse eje"
    ),
}
LETTERS = {
    "a": "acceleration", "w": "rate", "ω": "rate", "g": "letter", "f": "letter", "m": "field", "b": "field", "h": "field",
    "q": "orientation", "r": "orientation", "v": "velocity", "p": "place", "d": "other", "e": "other",
}  # fmt: skip
# Units, by quantity and as this program writes them; an empty one is recognised and not used.
UNITS = {
    "acceleration": {
        "g": "g gs g's gn g0 gforce",
        "mg": "mg millig milligs milli-g mgee",
        "ms2": "m/s2 ms2 ms-2 m/s/s mps2 mpss m/(s2) m/ss m.s-2 mss",
    },
    "rate": {
        "dps": "dps deg/s d/s degs degs-1 deg/(s) deg.s-1 degps",
        "rads": "rad/s rads rads-1 radps rps rad.s-1",
        "": "mdps mdeg/s mrad/s rpm",
    },
    "field": {"": "ut μt mt nt gauss mgauss ga mga t microt microtesla tesla localflux"},
    "orientation": {"deg": "deg", "": "rad"},
    "temperature": {"degc": "degc c celsius gradc", "": "degf f k kelvin fahrenheit"},
    "time": {
        "s": "s 秒 초 sek sekunden secondes secondi segundos сек",
        "ms": "ms msec msecs milliseconds millis millisecond",
        "us": "us μs usec usecs microsec microseconds micros",
        "ns": "ns nsec nsecs nanosec nanoseconds nanos",
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours",
        "100us": "100us 100μs 0.1ms",
    },
    "counts": {"counts": "lsb count counts adc digit digits bit bits nounits no_units"},
    "other": {
        "": "m cm mm km m/s km/h kmh kph mph pa hpa kpa mbar bar v mv ma a hz khz bpm db lux lx % cd n nm w wh mah flags txt"
    },
}
